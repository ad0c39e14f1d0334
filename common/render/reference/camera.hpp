// From a place in the picture to a ray. FORMAT.md, section 4.
#pragma once

#include "common/render/reference/ray.hpp"
#include "common/scene/scene.hpp"

#include <optional>

namespace fraja::reference {

/// Either of Raja's cameras, with its screen computed.
class PreparedCamera {
public:
    explicit PreparedCamera(const Camera& camera);

    /// The ray through (x, y), from (0, 0) at the top left to (1, 1) at the bottom right. It starts
    /// on the screen, without an owner.
    ///
    /// Where Raja has no answer: a place of the screen at the eye itself (focal = 0) looks along
    /// the camera's direction, and a camera that looks straight up or down has (0, 1, 0) to its
    /// left.
    [[nodiscard]] Ray ray(double x, double y) const;

private:
    [[nodiscard]] Ray eye_ray(double x, double y) const;

    Vec3 origin_{}, dir_{};
    Vec3 top_left_{}, rightwards_{}, downwards_{};
    std::optional<Vec3> to_left_eye_; ///< of a StereoCamera
};

} // namespace fraja::reference
