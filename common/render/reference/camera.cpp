#include "common/render/reference/camera.hpp"

namespace fraja::reference {
namespace {

Vec3 leftwards(const Vec3& dir) {
    const Vec3 left = normalized({-dir.y, dir.x, 0});
    return is_finite(left) ? left : Vec3{0, 1, 0};
}

} // namespace

PreparedCamera::PreparedCamera(const Camera& camera) {
    const auto* stereo = std::get_if<StereoCamera>(&camera);
    const HorizontalCamera& eye = stereo ? stereo->eye : std::get<HorizontalCamera>(camera);

    origin_ = eye.origin;
    dir_ = normalized(eye.direction);
    const Vec3 center = origin_ + eye.focal * dir_;
    const Vec3 left = leftwards(dir_);
    const Vec3 up = cross(dir_, left);
    const Vec3 half_left = (eye.screen_width / 2) * left;
    const Vec3 half_up = (eye.screen_height / 2) * up;
    top_left_ = center + (half_left + half_up);
    rightwards_ = (center + (-half_left + half_up)) - top_left_;
    downwards_ = (center + (half_left + -half_up)) - top_left_;
    if (stereo)
        to_left_eye_ = (stereo->step / 2) * leftwards(eye.direction);
}

Ray PreparedCamera::eye_ray(double x, double y) const {
    const Vec3 on_screen = (top_left_ + x * rightwards_) + y * downwards_;
    const Ray ray = make_ray({on_screen, no_owner}, on_screen - origin_);
    return is_finite(ray.dir) ? ray : make_ray(ray.start, dir_);
}

Ray PreparedCamera::ray(double x, double y) const {
    if (!to_left_eye_)
        return eye_ray(x, y);
    const bool left_eye = x < 0.5;
    Ray ray = eye_ray(left_eye ? 2 * x : 2 * x - 1, y);
    ray.start.position += left_eye ? *to_left_eye_ : -*to_left_eye_;
    return ray;
}

} // namespace fraja::reference
