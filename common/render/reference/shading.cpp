#include "common/render/reference/shading.hpp"

#include "common/render/cut_level.hpp"
#include "common/render/reference/fresnel.hpp"
#include "common/render/reference/highlight.hpp"
#include "common/render/reference/texture.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fraja::reference {
namespace {

constexpr std::uint64_t rays_per_report = 256;

} // namespace

/// A ray at a surface.
struct Tracer::Incidence {
    const SolidHit& hit;
    Vec3 dir;        ///< of the ray
    double cosine;   ///< between normal and ray; its sign says from where
    bool inside;     ///< the ray comes from within
    Vec3 mirror_dir; ///< not normalised
    LocalTexture texture;
};

Tracer::Tracer(const Model& model, const RenderSettings& settings, RenderControl& control,
               Interrupt& interrupt)
    : model_(model), settings_(settings), control_(control), interrupt_(interrupt),
      solids_(model, interrupt), cut_(cut_level(model.scene->world, settings)) {}

std::optional<Rgb> Tracer::radiance(double x, double y) {
    interrupt_.poll();
    if (interrupt_.raised())
        return std::nullopt;
    given_up_ = {};
    const Rgb light = light_along({.ray = model_.camera.ray(x, y), .depth = settings_.depth});
    return interrupt_.raised() ? std::nullopt : std::optional(light);
}

void Tracer::report_rays() {
    control_.rays.fetch_add(unreported_rays_, std::memory_order_relaxed);
    unreported_rays_ = 0;
}

void Tracer::count(std::uint64_t RayCounts::*kind) {
    ++(rays_.*kind);
    if (++unreported_rays_ == rays_per_report)
        report_rays();
    interrupt_.poll();
}

bool Tracer::below_cut(const Rgb& c) const {
    // A coefficient that is not a number, which only absurd scenes give, counts as below.
    return !(c.x > cut_.x) && !(c.y > cut_.y) && !(c.z > cut_.z);
}

bool Tracer::goes_on(const Path& path) {
    if (path.depth == 0)
        return false;
    const bool below = below_cut(path.coefficient);
    if (below)
        give_up(path.coefficient);
    return !below;
}

void Tracer::give_up(const Rgb& coefficient) {
    for (glm::length_t c = 0; c < 3; ++c)
        given_up_[c] += coefficient[c] > 0 ? coefficient[c] : 0;
}

// Raja's recursion light(ray) = (local + light(refracted)) + light(reflected), with a stack of our
// own: depth is the user's, the thread's stack is not. The order of the additions is Raja's.
Rgb Tracer::light_along(const Path& first) {
    open_.clear();
    Rgb light{};
    std::optional<Path> path = goes_on(first) ? std::optional(first) : std::nullopt;
    while (path) {
        Bounce found = bounce(*path);
        path = std::exchange(found.refracted ? found.refracted : found.reflected, std::nullopt);
        if (path) {
            keep_open(found);
        } else {
            light = found.light;
            path = close_with(light);
        }
        if (interrupt_.raised())
            return {};
    }
    return light;
}

/// Remembers a bounce whose light is not all there, unless nothing will have to be done about it.
void Tracer::keep_open(const Bounce& bounce) {
    if (bounce.light == Rgb{} && !bounce.reflected)
        return;
    if (open_.size() < open_bounces_max)
        open_.push_back({bounce.light, bounce.reflected});
    else
        interrupt_.raise(ErrorCode::limit_exceeded,
                         "a ray bounces more than " + std::to_string(open_bounces_max) +
                             " times without fading; draw with a smaller depth");
}

/// Adds the light of a path that has ended to the bounces that wait for it, and what is then
/// complete to those before. The path to follow next; nothing when `light` is the whole ray's.
std::optional<Tracer::Path> Tracer::close_with(Rgb& light) {
    while (!open_.empty()) {
        OpenBounce& last = open_.back();
        last.light += light;
        if (last.reflected)
            return std::exchange(last.reflected, std::nullopt);
        light = last.light;
        open_.pop_back();
    }
    return std::nullopt;
}

Tracer::Bounce Tracer::bounce(const Path& path) {
    count(path.kind);
    const World& world = model_.scene->world;
    const std::optional<SolidHit> hit = solids_.first_hit(world.solid, path.ray);
    if (!hit)
        return {world.background_light * path.coefficient, std::nullopt, std::nullopt};

    const Vec3& normal = hit->surface.normal;
    const Vec3& dir = path.ray.dir;
    const double cosine = dot(normal, dir);
    const bool inside = cosine > 0;
    const TextureIndex texture = inside ? hit->surface.texture_in : hit->surface.texture_out;
    const Incidence incidence{
        *hit,
        dir,
        cosine,
        inside,
        dir + (-2 * cosine) * normal,
        texture_at(model_.scene->textures[as_size(texture)], hit->surface.point.position)};

    Bounce result{local_light(incidence) * path.coefficient, std::nullopt, std::nullopt};
    Rgb krg = incidence.texture.krg;
    transmit(incidence, path, krg, result.refracted);
    const Path reflected{make_ray(hit->surface.point, incidence.mirror_dir), krg * path.coefficient,
                         path.depth - 1, &RayCounts::reflected};
    if (goes_on(reflected))
        result.reflected = reflected;
    return result;
}

/// Step 5 of 6.2: what the surface lets through, and what of that it reflects instead.
void Tracer::transmit(const Incidence& at, const Path& path, Rgb& krg,
                      std::optional<Path>& refracted) {
    const Rgb& ktg = at.texture.ktg;
    if (below_cut(ktg * path.coefficient)) {
        if (path.depth > 1)
            give_up(ktg * path.coefficient);
        return;
    }
    const Point& p = at.hit.surface.point;
    const std::optional<Refraction> refraction =
        refract({.dir = at.dir,
                 .normal = at.hit.surface.normal,
                 .index_in = solids_.refractive_index(at.hit.inner, p),
                 .index_out = solids_.refractive_index(at.hit.outer, p)});
    if (!refraction) {
        krg = krg + ktg;
        return;
    }
    krg = krg + refraction->reflectance * ktg;
    const Rgb coefficient = ((1 - refraction->reflectance) * ktg) * path.coefficient;
    const Path onwards{make_ray(p, refraction->dir), coefficient, path.depth - 1,
                       &RayCounts::refracted};
    if (goes_on(onwards))
        refracted = onwards;
}

Rgb Tracer::local_light(const Incidence& at) {
    const World& world = model_.scene->world;
    Rgb sum = world.ambient_light * at.texture.kd;
    for (const Light& light : world.lights)
        sum += std::visit([&](const auto& source) { return light_from(source, at); }, light);
    return sum;
}

Rgb Tracer::light_from(const PointLight& source, const Incidence& at) {
    const Vec3 way = source.origin - at.hit.surface.point.position;
    return light_from(normalized(way), length(way), source.light, at);
}

Rgb Tracer::light_from(const DirectionalLight& source, const Incidence& at) {
    return light_from(normalized(-source.direction), std::numeric_limits<double>::infinity(),
                      source.light, at);
}

/// The formula of 6.3 for one light; black where the surface faces away or a solid is in the way.
Rgb Tracer::light_from(const Vec3& to_light, double distance, const Rgb& light,
                       const Incidence& at) {
    const Vec3& normal = at.hit.surface.normal;
    const double cosine = at.inside ? -dot(normal, to_light) : dot(normal, to_light);
    if (!(cosine >= 0)) // also where the light stands on the surface
        return {};
    count(&RayCounts::shadow);
    if (solids_.blocks(model_.scene->world.solid, make_ray(at.hit.surface.point, to_light),
                       distance))
        return {};
    const double h = highlight(dot(to_light, at.mirror_dir), at.texture.ns);
    return ((light * cosine) * at.texture.kd) + ((light * h) * at.texture.krl);
}

} // namespace fraja::reference
