// How a picture is drawn, as it travels. Scenes and pixels are bytes here.
#pragma once

#include "common/base/instant.hpp"
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

enum class PixelFilter : std::uint8_t { box, tent };
template <>
struct ValueCount<PixelFilter> {
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
    std::uint32_t spp = 0;
    double error = 0;
    std::uint32_t max_samples = 1024;
    PixelFilter filter = PixelFilter::box;
    Duration time_limit{};
    bool layers = false;

    friend bool operator==(const PictureSettings&, const PictureSettings&) = default;
    template <class T = PictureSettings>
    static constexpr auto fields() {
        return std::tuple{Field{"size", &T::size},
                          Field{"crop", &T::crop},
                          Field{"depth", &T::depth},
                          Field{"aa", &T::aa},
                          Field{"exact", &T::exact},
                          Field{"kernel", &T::kernel},
                          Field{"spp", &T::spp},
                          Field{"error", &T::error},
                          Field{"max_samples", &T::max_samples},
                          Field{"filter", &T::filter},
                          Field{"time_limit", &T::time_limit},
                          Field{"layers", &T::layers}};
    }
    /// It is drawn in passes over all of it (passes.hpp).
    [[nodiscard]] bool limited_in_time() const { return time_limit > Duration::zero(); }
    /// Each pixel comes with its samples and its error.
    [[nodiscard]] bool estimates() const { return error > 0 || spp >= 4; }
    /// Of a pixel, as it travels: 32-bit floats. Red, green, blue; of a picture with estimates
    /// samples and error; of a pass the samples' variance, and the light that was cut; with layers
    /// the distance, three of the normal, and the solid.
    [[nodiscard]] std::uint64_t pixel_bytes() const {
        return sizeof(float) *
               (3u + (estimates() || limited_in_time() ? 2u : 0u) + (layers ? 5u : 0u));
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
