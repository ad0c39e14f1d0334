#include "common/render/reference/csg_search.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::reference {
namespace {

constexpr std::uint32_t steps_per_poll = 1024;

Border opposite(Border border) {
    return border == Border::counts ? Border::does_not_count : Border::counts;
}

bool nearer_than(double distance, const Point& p, const Ray& ray) {
    return std::sqrt(distance_squared(p.position, ray.start.position)) < distance;
}

} // namespace

std::optional<SurfaceHit> CsgSearch::first_hit(TexturedFormIndex index, const Ray& ray) {
    return std::visit([&](const auto& form) { return first_hit_of(form, ray); },
                      model_.textured_forms[as_size(index)]);
}

bool CsgSearch::contains(TexturedFormIndex index, const Point& p, Border border) {
    return std::visit([&](const auto& form) { return contained_in(form, p, border); },
                      model_.textured_forms[as_size(index)]);
}

bool CsgSearch::blocks(TexturedFormIndex index, const Ray& ray, double distance) {
    return std::visit([&](const auto& form) { return blocked_by(form, ray, distance); },
                      model_.textured_forms[as_size(index)]);
}

// A textured form used many times, by forms that are used many times, is a tree that one ray could
// search for years: so the owner's wish to stop is heard in here, too.
bool CsgSearch::interrupted() {
    if (++steps_ % steps_per_poll == 0)
        interrupt_.poll();
    return interrupt_.raised();
}

// ----------------------------------------------------------------------------- BasicTexturedForm

std::optional<SurfaceHit> CsgSearch::first_hit_of(const BasicTexturedForm& form, const Ray& ray) {
    const Primitive& primitive = model_.primitives[as_size(form.form)];
    const std::optional<Point> p = intersect(primitive, ray);
    if (!p)
        return std::nullopt;
    return SurfaceHit{*p, normal(primitive, p->position), form.texture_in, form.texture_out};
}

bool CsgSearch::contained_in(const BasicTexturedForm& form, const Point& p, Border border) {
    const Primitive& primitive = model_.primitives[as_size(form.form)];
    return border == Border::counts ? reference::contains(primitive, p)
                                    : strictly_contains(primitive, p);
}

bool CsgSearch::blocked_by(const BasicTexturedForm& form, const Ray& ray, double distance) {
    const std::optional<Point> p = intersect(model_.primitives[as_size(form.form)], ray);
    return p && nearer_than(distance, *p, ray);
}

// ------------------------------------------------------------------------------------ Complement

std::optional<SurfaceHit> CsgSearch::first_hit_of(const Complement& form, const Ray& ray) {
    std::optional<SurfaceHit> hit = first_hit(form.of, ray);
    if (hit) {
        hit->normal = -hit->normal;
        std::swap(hit->texture_in, hit->texture_out);
    }
    return hit;
}

bool CsgSearch::contained_in(const Complement& form, const Point& p, Border border) {
    return !contains(form.of, p, opposite(border));
}

bool CsgSearch::blocked_by(const Complement& form, const Ray& ray, double distance) {
    return blocks(form.of, ray, distance);
}

// ------------------------------------------------------------------------- Union and Intersection

bool CsgSearch::contained_in(const Composite& form, const Point& p, Border border) {
    if (interrupted())
        return false;
    const auto has_point = [&](TexturedFormIndex member) { return contains(member, p, border); };
    return form.kind == Composite::Kind::any_member
               ? std::any_of(form.members.begin(), form.members.end(), has_point)
               : std::all_of(form.members.begin(), form.members.end(), has_point);
}

// While a member is pending at a point, the composite's surface is not there: the point is within
// another member of a Union, or outside a member of an Intersection.
bool CsgSearch::pending(const Composite& form, TexturedFormIndex member, const Point& p) {
    return form.kind == Composite::Kind::any_member ? contains(member, p, Border::does_not_count)
                                                    : !contains(member, p, Border::counts);
}

bool CsgSearch::any_pending(const Composite& form, const Point& p) {
    return std::any_of(form.members.begin(), form.members.end(),
                       [&](TexturedFormIndex member) { return pending(form, member, p); });
}

std::optional<SurfaceHit> CsgSearch::nearest(const Composite& form, const Ray& ray) {
    std::optional<SurfaceHit> best;
    double best_distance = 0;
    for (const TexturedFormIndex member : form.members) {
        const std::optional<SurfaceHit> hit = first_hit(member, ray);
        if (!hit)
            continue;
        const double d = distance_squared(hit->point.position, ray.start.position);
        if (!best || d < best_distance)
            best = hit, best_distance = d;
    }
    return best;
}

/// The farthest hit of the members pending at the ray's start. Nothing when one of them is not met
/// at all, since the ray never gets past it, and when all are met at distance 0, where Raja fails.
std::optional<SurfaceHit> CsgSearch::farthest_pending(const Composite& form, const Ray& ray) {
    std::optional<SurfaceHit> best;
    double best_distance = 0;
    for (const TexturedFormIndex member : form.members) {
        if (!pending(form, member, ray.start))
            continue;
        const std::optional<SurfaceHit> hit = first_hit(member, ray);
        if (!hit)
            return std::nullopt;
        const double d = distance_squared(hit->point.position, ray.start.position);
        if (d > best_distance)
            best = hit, best_distance = d;
    }
    return best;
}

std::optional<SurfaceHit> CsgSearch::first_hit_of(const Composite& form, const Ray& ray) {
    Ray present = ray;
    bool past_pending = any_pending(form, ray.start);
    for (std::uint64_t restarts = 0; restarts <= form.restarts_max; ++restarts) {
        if (interrupted())
            return std::nullopt;
        const std::optional<SurfaceHit> candidate =
            past_pending ? farthest_pending(form, present) : nearest(form, present);
        if (!candidate || !any_pending(form, candidate->point))
            return candidate;
        present = make_ray(candidate->point, present.dir);
        past_pending = true;
    }
    return std::nullopt; // rounding goes round in circles
}

bool CsgSearch::blocked_by_members(const Composite& form, const Point& start) {
    return form.kind == Composite::Kind::any_member
               ? !contained_in(form, start, Border::counts)
               : contained_in(form, start, Border::does_not_count);
}

bool CsgSearch::blocked_by(const Composite& form, const Ray& ray, double distance) {
    if (blocked_by_members(form, ray.start))
        return std::any_of(form.members.begin(), form.members.end(),
                           [&](TexturedFormIndex member) { return blocks(member, ray, distance); });
    const std::optional<SurfaceHit> hit = first_hit_of(form, ray);
    return hit && nearer_than(distance, hit->point, ray);
}

} // namespace fraja::reference
