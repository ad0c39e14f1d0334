#include "client/preview/kitty.hpp"

#include <cstddef>
#include <fmt/core.h>
#include <sodium.h>
#include <span>
#include <string_view>

namespace fraja::client {
namespace {

constexpr std::size_t chunk_bytes_max = 4096; // of base64, says the protocol

std::string base64(std::span<const std::uint8_t> bytes) {
    constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
    std::string text(sodium_base64_encoded_len(bytes.size(), variant), '\0');
    sodium_bin2base64(text.data(), text.size(), bytes.data(), bytes.size(), variant);
    text.pop_back(); // the string ends without a zero of its own
    return text;
}

} // namespace

std::string kitty_image(const LevelsPicture& levels, std::uint32_t id, std::uint32_t columns,
                        std::uint32_t rows) {
    const std::string all = base64(levels.rgb);
    std::string text;
    for (std::size_t begin = 0; begin < all.size(); begin += chunk_bytes_max) {
        const bool more = begin + chunk_bytes_max < all.size();
        text += begin == 0
                    ? fmt::format("\x1b_Ga=T,f=24,s={},v={},i={},p=1,c={},r={},C=1,q=2,m={};",
                                  levels.extent.width, levels.extent.height, id, columns, rows,
                                  more ? 1 : 0)
                    : fmt::format("\x1b_Gm={};", more ? 1 : 0);
        text += std::string_view(all).substr(begin, chunk_bytes_max);
        text += "\x1b\\";
    }
    return text;
}

std::string kitty_removal(std::uint32_t id) {
    return fmt::format("\x1b_Ga=d,d=I,i={},q=2\x1b\\", id);
}

} // namespace fraja::client
