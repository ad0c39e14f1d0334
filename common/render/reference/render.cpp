#include "common/render/reference/render.hpp"

#include "common/render/cut_level.hpp"
#include "common/render/reference/shading.hpp"

#include <algorithm>
#include <bit>

namespace fraja::reference {
namespace {

class ReferenceScene final : public CompiledScene {
public:
    explicit ReferenceScene(std::shared_ptr<const Scene> scene)
        : CompiledScene(*scene), model_(std::move(scene)) {}

    Result<DrawnBlock> draw_samples(const RenderSettings& settings, const SampleBlock& block,
                                    RenderControl& control) const override {
        Interrupt interrupt(control.stop);
        Tracer tracer(model_, settings, control, interrupt);
        const Rgb light = all_light(model_.scene->world);
        for (std::size_t i = 0; i < block.x.size(); ++i) {
            const std::uint64_t rays_before = tracer.rays().traced();
            const std::optional<Rgb> rgb = tracer.radiance(block.x[i], block.y[i]);
            if (!rgb)
                return interrupt.error();
            const Rgb cut = tracer.given_up() * light;
            for (glm::length_t c = 0; c < 3; ++c) {
                block.rgb[3 * i + static_cast<std::size_t>(c)] = (*rgb)[c];
                if (!block.cut.empty())
                    block.cut[3 * i + static_cast<std::size_t>(c)] = cut[c];
            }
            const std::uint64_t rays = tracer.rays().traced() - rays_before;
            block.rays[i] = static_cast<std::uint32_t>(std::min<std::uint64_t>(rays, UINT32_MAX));
            tracer.report_rays();
        }
        std::ranges::fill(block.lost, 0.0); // not known
        // Nor is what they met: so no two places have met the same.
        for (std::size_t i = 0; i < block.paths.size(); ++i)
            block.paths[i] = std::bit_cast<std::uint64_t>(block.x[i]) * 0x9e3779b97f4a7c15 +
                             std::bit_cast<std::uint64_t>(block.y[i]);
        return DrawnBlock{.rays = tracer.rays()};
    }

    Result<RayCounts> find_first_hits(const FirstHitBlock& block,
                                      RenderControl& control) const override {
        Interrupt interrupt(control.stop);
        SolidSearch solids(model_, interrupt);
        for (std::size_t i = 0; i < block.x.size(); ++i) {
            interrupt.poll();
            const auto hit = solids.first_hit(model_.scene->world.solid,
                                              model_.camera.ray(block.x[i], block.y[i]));
            if (interrupt.raised())
                return interrupt.error();
            control.rays.fetch_add(1, std::memory_order_relaxed);
            if (hit)
                block.hits[i] = {.place = hit->surface.point.position,
                                 .normal = normalized(hit->surface.normal),
                                 .object = static_cast<std::uint32_t>(as_size(hit->solid)) + 1};
        }
        return RayCounts{.camera = block.x.size()};
    }

private:
    Model model_;
};

} // namespace

std::shared_ptr<const CompiledScene> compile(std::shared_ptr<const Scene> scene) {
    return std::make_shared<const ReferenceScene>(std::move(scene));
}

} // namespace fraja::reference
