// Textured forms: constructive solid geometry by restarted rays. FORMAT.md, sections 8.3 and 8.4.
#pragma once

#include "common/render/reference/interrupt.hpp"
#include "common/render/reference/model.hpp"
#include "common/render/reference/ray.hpp"

#include <cstdint>
#include <optional>

namespace fraja::reference {

/// Where a ray meets a textured form.
struct SurfaceHit {
    Point point;
    Vec3 normal{}; ///< outwards; turned round by each Complement
    TextureIndex texture_in{}, texture_out{};
};

/// Whether a point on a surface counts as contained.
enum class Border : std::uint8_t { counts, does_not_count };

/// Asks what a ray meets among a model's textured forms. Its answers depend on the model alone, but
/// for an interrupt, after which they are all "nothing". One thread's.
class CsgSearch {
public:
    CsgSearch(const Model& model, Interrupt& interrupt) : model_(model), interrupt_(interrupt) {}

    [[nodiscard]] std::optional<SurfaceHit> first_hit(TexturedFormIndex, const Ray&);
    [[nodiscard]] bool contains(TexturedFormIndex, const Point&, Border);
    /// Whether light on its way along the ray is stopped nearer than `distance`.
    [[nodiscard]] bool blocks(TexturedFormIndex, const Ray&, double distance);

private:
    [[nodiscard]] bool interrupted();

    // The three verbs for each kind of textured form.
    std::optional<SurfaceHit> first_hit_of(const BasicTexturedForm&, const Ray&);
    std::optional<SurfaceHit> first_hit_of(const Complement&, const Ray&);
    std::optional<SurfaceHit> first_hit_of(const Composite&, const Ray&);
    bool contained_in(const BasicTexturedForm&, const Point&, Border);
    bool contained_in(const Complement&, const Point&, Border);
    bool contained_in(const Composite&, const Point&, Border);
    bool blocked_by(const BasicTexturedForm&, const Ray&, double distance);
    bool blocked_by(const Complement&, const Ray&, double distance);
    bool blocked_by(const Composite&, const Ray&, double distance);

    bool pending(const Composite&, TexturedFormIndex member, const Point&);
    bool any_pending(const Composite&, const Point&);
    std::optional<SurfaceHit> nearest(const Composite&, const Ray&);
    std::optional<SurfaceHit> farthest_pending(const Composite&, const Ray&);
    /// Whether, at the ray's start, what blocks a member blocks the composite.
    bool blocked_by_members(const Composite&, const Point&);

    const Model& model_;
    Interrupt& interrupt_;
    std::uint32_t steps_ = 0;
};

} // namespace fraja::reference
