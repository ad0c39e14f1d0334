#include "tests/sim/pixels.hpp"

#include "common/base/rng.hpp"
#include "common/protocol/pixels.hpp"

#include <cstring>

namespace fraja::sim {

Bytes pixels_of(const PictureOf& picture, PixelRect rect) {
    const std::uint64_t pixel_bytes = picture.settings.pixel_bytes();
    Bytes bytes(rect.pixel_count() * pixel_bytes);
    std::uint64_t scene = 0;
    std::memcpy(&scene, picture.scene.bytes.data(), sizeof scene);
    const std::uint64_t key =
        Rng(scene ^ std::uint64_t{picture.pass} << 32 ^ picture.settings.depth).next();
    const std::uint64_t pixels = rect.pixel_count();
    std::uint64_t pixel = 0;
    for (std::uint32_t y = rect.y; y < rect.y + rect.height; ++y)
        for (std::uint32_t x = rect.x; x < rect.x + rect.width; ++x, ++pixel) {
            const std::uint64_t bits = Rng(key ^ (std::uint64_t{y} << 32 | x)).next();
            for (std::uint64_t done = 0; done < pixel_bytes; done += protocol::plane_bytes) {
                const auto part = static_cast<std::uint32_t>(bits >> (done % 8 * 8)) ^
                                  static_cast<std::uint32_t>(done);
                const std::uint64_t at =
                    done < protocol::colour_bytes
                        ? pixel * protocol::colour_bytes + done
                        : pixels * done +
                              pixel * protocol::plane_bytes; // planes follow one another
                std::memcpy(bytes.data() + at, &part, sizeof part);
            }
        }
    return bytes;
}

bool are_pixels_of(const PictureOf& picture, PixelRect rect, const std::vector<Blob>& blobs) {
    const Bytes wanted = pixels_of(picture, rect);
    std::size_t at = 0;
    for (const Blob& blob : blobs) {
        if (blob.size() > wanted.size() - at ||
            std::memcmp(blob.data(), wanted.data() + at, blob.size()) != 0)
            return false;
        at += blob.size();
    }
    return at == wanted.size();
}

} // namespace fraja::sim
