// How a picture is drawn, as it travels. Scenes and pixels are bytes here.
#pragma once

#include "common/base/pixel_rect.hpp"
#include "common/base/result.hpp"
#include "common/protocol/fields.hpp"

#include <cstdint>

namespace fraja::protocol {

enum class KernelChoice : std::uint8_t { reference, fast };
template <>
struct ValueCount<KernelChoice> {
    static constexpr unsigned value = 2;
};

struct PictureSettings {
    Extent size{256, 192};
    PixelRect crop{0, 0, 256,
                   192}; ///< what is drawn of it; all of it where nothing else was asked for
    std::uint32_t depth = 5;
    std::uint32_t aa = 0;
    bool exact = false;
    KernelChoice kernel = KernelChoice::fast;

    friend bool operator==(const PictureSettings&, const PictureSettings&) = default;
    static constexpr auto fields() {
        using T = PictureSettings;
        return std::tuple{Field{"size", &T::size},   Field{"crop", &T::crop},
                          Field{"depth", &T::depth}, Field{"aa", &T::aa},
                          Field{"exact", &T::exact}, Field{"kernel", &T::kernel}};
    }
};

/// The order in which the tiles of a picture are handed out. It never changes pixels.
enum class TileOrder : std::uint8_t { automatic, scan, spiral, diadic };
template <>
struct ValueCount<TileOrder> {
    static constexpr unsigned value = 4;
};

/// Whether the settings are within the limits and the crop within the picture. The error names the
/// option.
[[nodiscard]] Result<void> validate(const PictureSettings& settings);

} // namespace fraja::protocol
