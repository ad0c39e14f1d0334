// Speed: what is known of how fast somebody is.
#pragma once

#include "common/base/instant.hpp"

namespace fraja::broker {

/// Of rays and the time they took. The more have been seen, the less counts what was thought
/// before.
class Speed {
public:
    void add(double rays, Duration time) {
        const double s = seconds(time);
        rays_ = keep * rays_ + rays;
        seconds_ = keep * seconds_ + s;
        tile_s_ = keep * tile_s_ + (1 - keep) * s;
    }
    [[nodiscard]] bool is_known() const { return rays_ > 0 && seconds_ > 0; }
    /// `prior`: what is thought where nothing is known.
    [[nodiscard]] double rays_per_s(double prior) const {
        const double weight_s = prior_tiles * tile_s_;
        return is_known() ? (rays_ + prior * weight_s) / (seconds_ + weight_s) : prior;
    }
    [[nodiscard]] double rays_per_s() const { return is_known() ? rays_ / seconds_ : 0; }

private:
    static constexpr double keep = 0.98;     ///< of what is known, with every tile
    static constexpr double prior_tiles = 2; ///< as so many tiles what was thought before weighs
    double rays_ = 0, seconds_ = 0;
    double tile_s_ = 0; ///< that a tile takes, about; it starts low, where it does no harm
};

} // namespace fraja::broker
