#include "common/base/ids.hpp"

#include <random>

namespace fraja {
namespace {

constexpr char digits[] = "0123456789abcdef";

std::optional<unsigned> hex_digit(char c) {
    if (c >= '0' && c <= '9')
        return static_cast<unsigned>(c - '0');
    if (c >= 'a' && c <= 'f')
        return static_cast<unsigned>(c - 'a' + 10);
    if (c >= 'A' && c <= 'F')
        return static_cast<unsigned>(c - 'A' + 10);
    return std::nullopt;
}

bool dash_before(std::size_t byte) {
    return byte == 4 || byte == 6 || byte == 8 || byte == 10;
}

} // namespace

namespace detail {

std::string format_uuid(const std::array<std::uint8_t, 16>& bytes) {
    std::string text;
    text.reserve(36);
    for (std::size_t i = 0; i < bytes.size(); ++i) {
        if (dash_before(i))
            text += '-';
        text += digits[bytes[i] >> 4];
        text += digits[bytes[i] & 15];
    }
    return text;
}

std::optional<std::array<std::uint8_t, 16>> parse_uuid(std::string_view text) {
    if (text.size() != 36)
        return std::nullopt;
    std::array<std::uint8_t, 16> bytes{};
    std::size_t at = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
        if (dash_before(i) && text[at++] != '-')
            return std::nullopt;
        const auto high = hex_digit(text[at]), low = hex_digit(text[at + 1]);
        if (!high || !low)
            return std::nullopt;
        bytes[i] = static_cast<std::uint8_t>(*high << 4 | *low);
        at += 2;
    }
    return bytes;
}

std::array<std::uint8_t, 16> random_uuid() {
    std::random_device device; // /dev/urandom or the like: never seeded by us
    std::array<std::uint8_t, 16> bytes{};
    for (std::size_t i = 0; i < bytes.size(); i += 4) {
        const std::uint32_t word = device();
        for (std::size_t k = 0; k < 4; ++k)
            bytes[i + k] = static_cast<std::uint8_t>(word >> (8 * k));
    }
    bytes[6] = static_cast<std::uint8_t>((bytes[6] & 0x0f) | 0x40);
    bytes[8] = static_cast<std::uint8_t>((bytes[8] & 0x3f) | 0x80);
    return bytes;
}

} // namespace detail

std::string to_string(const ContentHash& hash) {
    std::string text;
    text.reserve(64);
    for (const std::uint8_t b : hash.bytes) {
        text += digits[b >> 4];
        text += digits[b & 15];
    }
    return text;
}

Rng fresh_rng() {
    const Nonce random = random_id<Nonce>();
    std::uint64_t seed = 0;
    for (const std::uint8_t byte : random.bytes) // both halves: 6 of the 128 bits are fixed
        seed = (seed << 8 | seed >> 56) ^ byte;
    return Rng(seed);
}

} // namespace fraja
