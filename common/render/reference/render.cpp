#include "common/render/reference/render.hpp"

#include "common/render/reference/sampler.hpp"
#include "common/render/reference/shading.hpp"

#include <limits>

namespace fraja::reference {
namespace {

/// The last guard: absurd colours (1e300 times 1e300) must not put into a picture what is no
/// number.
float as_float(double radiance) {
    constexpr float float_max = std::numeric_limits<float>::max();
    if (!(radiance > 0))
        return 0;
    return radiance < static_cast<double>(float_max) ? static_cast<float>(radiance) : float_max;
}

class ReferenceScene final : public CompiledScene {
public:
    explicit ReferenceScene(std::shared_ptr<const Scene> scene) : model_(std::move(scene)) {}

    Result<RenderedTile> render_tile(const RenderSettings& settings, PixelRect rect,
                                     RenderControl& control) const override {
        FRAJA_ASSERT(!rect.empty() && rect.inside(settings.size));
        Interrupt interrupt(control.stop);
        Tracer tracer(model_, settings, control, interrupt);
        const auto radiance = [&](double x, double y) { return tracer.radiance(x, y); };

        RenderedTile result{.tile = {.rect = rect, .rgb = {}}, .rays = {}, .truncated = {}};
        result.tile.rgb.reserve(3 * rect.pixel_count());
        for (std::uint32_t row = rect.y; row < rect.y + rect.height; ++row)
            for (std::uint32_t column = rect.x; column < rect.x + rect.width; ++column) {
                const auto rgb = sample_pixel(settings.size, {column, row}, settings.aa, radiance);
                if (!rgb)
                    return interrupt.error();
                for (const double component : {rgb->x, rgb->y, rgb->z})
                    result.tile.rgb.push_back(as_float(component));
                tracer.report_rays();
            }
        result.rays = tracer.rays();
        return result;
    }

private:
    Model model_;
};

} // namespace

std::shared_ptr<const CompiledScene> compile(std::shared_ptr<const Scene> scene) {
    return std::make_shared<const ReferenceScene>(std::move(scene));
}

} // namespace fraja::reference
