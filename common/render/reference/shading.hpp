// The light that arrives along a ray. FORMAT.md, sections 6 and 7.
#pragma once

#include "common/render/reference/interrupt.hpp"
#include "common/render/reference/model.hpp"
#include "common/render/reference/solid_search.hpp"
#include "common/render/render.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace fraja::reference {

/// Follows one camera ray after another. One thread's.
class Tracer {
public:
    /// How many bounces that light must still be added up for can be remembered at once; a path of
    /// more raises limit_exceeded. Mirrors alone (no local light) need no memory.
    static constexpr std::size_t open_bounces_max = std::size_t{1} << 20;

    Tracer(const Model& model, const RenderSettings& settings, RenderControl& control,
           Interrupt& interrupt);
    ~Tracer() { report_rays(); }
    Tracer(const Tracer&) = delete;
    Tracer& operator=(const Tracer&) = delete;

    /// The radiance at (x, y) of the picture; nothing once the interrupt is raised.
    [[nodiscard]] std::optional<Rgb> radiance(double x, double y);
    /// Adds the rays since the last report to the control's counter.
    void report_rays();

    /// Of the last radiance(), the weight of the paths below the cut level.
    [[nodiscard]] const Rgb& given_up() const { return given_up_; }
    [[nodiscard]] const RayCounts& rays() const { return rays_; }

private:
    /// A ray still to be followed, and what it may do.
    struct Path {
        Ray ray;
        Rgb coefficient{1, 1, 1}; ///< what becomes of its light on the way to the eye
        std::uint32_t depth = 0;  ///< surfaces it may still meet
        std::uint64_t RayCounts::*kind = &RayCounts::camera;
    };
    /// What a path finds: local light (or the background), and the paths that go on.
    struct Bounce {
        Rgb light{};
        std::optional<Path> refracted, reflected; ///< only those that go on
    };
    /// A bounce whose light is not complete yet.
    struct OpenBounce {
        Rgb light{};
        std::optional<Path> reflected; ///< not yet followed
    };
    struct Incidence;

    Rgb light_along(const Path& first);
    void keep_open(const Bounce&);
    std::optional<Path> close_with(Rgb& light);
    Bounce bounce(const Path& path);
    Rgb local_light(const Incidence&);
    Rgb light_from(const PointLight&, const Incidence&);
    Rgb light_from(const DirectionalLight&, const Incidence&);
    Rgb light_from(const Vec3& to_light, double distance, const Rgb& light, const Incidence&);
    void transmit(const Incidence&, const Path&, Rgb& krg, std::optional<Path>& refracted);
    [[nodiscard]] bool below_cut(const Rgb& coefficient) const;
    [[nodiscard]] bool goes_on(const Path& path);
    void give_up(const Rgb& coefficient);
    void count(std::uint64_t RayCounts::*kind);

    const Model& model_;
    const RenderSettings& settings_;
    RenderControl& control_;
    Interrupt& interrupt_;
    SolidSearch solids_;
    Rgb cut_{}, given_up_{};
    RayCounts rays_;
    std::uint64_t unreported_rays_ = 0;
    std::vector<OpenBounce> open_;
};

} // namespace fraja::reference
