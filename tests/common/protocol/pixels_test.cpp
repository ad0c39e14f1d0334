#include "common/protocol/pixels.hpp"

#include "common/protocol/limits.hpp"
#include "tests/support/seeds.hpp"

#include <algorithm>
#include <doctest/doctest.h>

namespace fraja::protocol {
namespace {

/// Byte `b` of a pixel in a plane.
std::byte at(std::uint32_t x, std::uint32_t y, std::uint64_t plane, std::uint64_t b) {
    return static_cast<std::byte>(x * 31 + y * 57 + plane * 101 + b * 7);
}

std::vector<Blob> pixels(const PixelRect& rect, std::uint64_t pixel_bytes, std::size_t cut) {
    Bytes bytes;
    for (std::uint64_t plane = 0; 8 + 4 * plane < pixel_bytes; ++plane)
        for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
            for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x)
                for (std::uint64_t b = 0; b < (plane == 0 ? colour_bytes : plane_bytes); ++b)
                    bytes.push_back(at(x, y, plane, b));
    std::vector<Blob> blobs;
    for (std::size_t begin = 0; begin < bytes.size(); begin += cut)
        blobs.push_back(Blob(Bytes(
            bytes.begin() + static_cast<std::ptrdiff_t>(begin),
            bytes.begin() + static_cast<std::ptrdiff_t>(std::min(begin + cut, bytes.size())))));
    return blobs;
}

std::vector<Blob> pixels_of_part(const std::vector<Blob>& blobs, const PixelRect& rect,
                                 const PixelRect& part, std::uint64_t pixel_bytes) {
    PixelPlanes planes(rect, pixel_bytes);
    planes.place(rect, blobs);
    return planes.blobs(part);
}

TEST_CASE("the pixels of a part are those that a tile of its size would have, in every plane") {
    for_each_seed(100, [](Rng& rng) {
        const auto number = [&](std::uint64_t most) {
            return static_cast<std::uint32_t>(rng.below(most));
        };
        const PixelRect rect{number(50), number(50), 1 + number(40), 1 + number(40)};
        const std::uint32_t x = number(rect.width), y = number(rect.height);
        const PixelRect part{rect.x + x, rect.y + y, 1 + number(rect.width - x),
                             1 + number(rect.height - y)};
        const std::uint64_t pixel_bytes = rng.below(2) == 0 ? 12 : 20;
        const auto got = pixels_of_part(pixels(rect, pixel_bytes, 1 + rng.below(3'000)), rect, part,
                                        pixel_bytes);
        const auto want = pixels(part, pixel_bytes, chunk_bytes);
        REQUIRE(got.size() == want.size());
        for (std::size_t i = 0; i < got.size(); ++i)
            CHECK((got[i] == want[i]));
    });
}

TEST_CASE("what is put together from parts, some of them twice, is the whole") {
    for_each_seed(50, [](Rng& rng) {
        const auto number = [&](std::uint64_t most) {
            return static_cast<std::uint32_t>(rng.below(most));
        };
        const PixelRect area{number(50), number(50), 1 + number(60), 1 + number(60)};
        const std::uint64_t pixel_bytes = rng.below(2) == 0 ? 12 : 20;
        PixelPlanes planes(area, pixel_bytes);
        std::vector<PixelRect> parts;
        for (std::uint32_t y = 0; y < area.height; y += 7)
            for (std::uint32_t x = 0; x < area.width; x += 5)
                parts.push_back({area.x + x, area.y + y, std::min(9u, area.width - x),
                                 std::min(8u, area.height - y)});
        for (std::size_t i = parts.size(); i > 1; --i)
            std::swap(parts[i - 1], parts[number(i)]);
        for (const PixelRect& part : parts)
            planes.place(part, pixels(part, pixel_bytes, 1 + rng.below(900)));
        CHECK((planes.blobs(area).at(0) == pixels(area, pixel_bytes, chunk_bytes).at(0)));
    });
}

TEST_CASE("the pixels of a large part are cut every chunk_bytes") {
    const PixelRect rect{0, 0, 400, 300}, part{1, 1, 300, 299};
    const auto got = pixels_of_part(pixels(rect, 12, chunk_bytes), rect, part, 12);
    REQUIRE(got.size() == 3);
    CHECK(got[0].size() == chunk_bytes);
}

TEST_CASE("floats may be cut between blobs; what is no whole float is left out") {
    const float floats[] = {1.5f, -2.0f, 0.25f};
    const auto all = std::as_bytes(std::span(floats));
    const auto cut = [&](std::size_t begin, std::size_t end) {
        return Blob(Bytes(all.begin() + static_cast<std::ptrdiff_t>(begin),
                          all.begin() + static_cast<std::ptrdiff_t>(end)));
    };
    CHECK(floats_of({cut(0, 3), cut(3, 9), cut(9, 12)}) ==
          std::vector<float>(std::begin(floats), std::end(floats)));
    CHECK(floats_of({cut(0, 5), cut(5, 11)}) == std::vector{1.5f, -2.0f});
    CHECK(floats_of({}).empty());
}

} // namespace
} // namespace fraja::protocol
