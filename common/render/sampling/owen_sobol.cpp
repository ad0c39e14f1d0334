#include "common/render/sampling/owen_sobol.hpp"

#include "common/base/rng.hpp"

#include <array>

namespace fraja {
namespace {

/// Of a byte of an index, the bits of Sobol's second coordinate, lowest first, that it stands for.
struct SecondCoordinate {
    std::array<std::array<std::uint32_t, 256>, 4> of_byte{};

    constexpr SecondCoordinate() {
        std::uint32_t direction[32] = {}; // the first digit after the point is bit 0
        direction[0] = 1;
        for (int i = 1; i < 32; ++i)
            direction[i] = direction[i - 1] ^ (direction[i - 1] << 1);
        for (std::size_t byte = 0; byte < 4; ++byte)
            for (std::uint32_t value = 0; value < 256; ++value)
                for (std::size_t bit = 0; bit < 8; ++bit)
                    if (value >> bit & 1u)
                        of_byte[byte][value] ^= direction[8 * byte + bit];
    }
    [[nodiscard]] constexpr std::uint32_t operator()(std::uint32_t index) const {
        return of_byte[0][index & 255] ^ of_byte[1][index >> 8 & 255] ^
               of_byte[2][index >> 16 & 255] ^ of_byte[3][index >> 24];
    }
};

constexpr SecondCoordinate second_coordinate;

/// Each bit is flipped or not by a hash of those below it.
constexpr std::uint32_t scrambled(std::uint32_t bits, std::uint32_t seed) {
    bits ^= bits * 0x3d20adea;
    bits += seed;
    bits *= (seed >> 16) | 1;
    bits ^= bits * 0x05526c56;
    bits ^= bits * 0x53a22864;
    return bits;
}

constexpr std::uint32_t reversed(std::uint32_t bits) {
    bits = __builtin_bswap32(bits);
    bits = (bits >> 4 & 0x0f0f0f0fu) | (bits & 0x0f0f0f0fu) << 4;
    bits = (bits >> 2 & 0x33333333u) | (bits & 0x33333333u) << 2;
    return (bits >> 1 & 0x55555555u) | (bits & 0x55555555u) << 1;
}

/// Digits after the point, lowest bit first, as a number; in the middle of what they stand for.
constexpr double as_fraction(std::uint32_t bits) {
    return (static_cast<double>(reversed(bits)) + 0.5) * 0x1p-32;
}

} // namespace

std::uint32_t mixed(std::uint64_t key) {
    return static_cast<std::uint32_t>(Rng(key).next());
}

OwenSobol::OwenSobol(std::uint32_t seed)
    : seed_x_(mixed(2 * std::uint64_t{seed})), seed_y_(mixed(2 * std::uint64_t{seed} + 1)) {}

SquarePoint OwenSobol::operator()(std::uint32_t index) const {
    return {as_fraction(scrambled(index, seed_x_)),
            as_fraction(scrambled(second_coordinate(index), seed_y_))};
}

} // namespace fraja
