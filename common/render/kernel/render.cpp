#include "common/render/kernel/render.hpp"

#include "common/render/cut_level.hpp"
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/program.hpp"

#include <span>
#include <utility>

namespace fraja::kernel {
namespace {

class KernelScene final : public CompiledScene {
public:
    KernelScene(Result<const KernelEntry*> entry, std::shared_ptr<const Scene> scene,
                std::unique_ptr<const Program> program)
        : entry_(std::move(entry)), scene_(std::move(scene)), program_(std::move(program)) {}

    Result<RenderedTile> render_tile(const RenderSettings& settings, PixelRect rect,
                                     RenderControl& control) const override {
        FRAJA_ASSERT(!rect.empty() && rect.inside(settings.size));
        if (!entry_)
            return entry_.error();

        RenderedTile result{.tile = {.rect = rect, .rgb = {}}, .rays = {}, .truncated = {}};
        result.tile.rgb.resize(3 * rect.pixel_count());
        if (settings.truncation)
            result.truncated.resize(rect.pixel_count());
        const Rgb cut = cut_level(scene_->world, settings.exact);
        const TileJob job{.picture_width = settings.size.width,
                          .picture_height = settings.size.height,
                          .x = rect.x,
                          .y = rect.y,
                          .width = rect.width,
                          .height = rect.height,
                          .depth = settings.depth,
                          .aa = settings.aa,
                          .cut = {cut.x, cut.y, cut.z},
                          .rgb = result.tile.rgb.data(),
                          .truncated = settings.truncation ? result.truncated.data() : nullptr};
        const TileControl tile_control{&control, &report};
        const TileResult drawn = (*entry_)->render_tile(program_->tables(), job, tile_control);
        switch (drawn.end) {
        case TileEnd::drawn:
            break;
        case TileEnd::stopped:
            return Error{ErrorCode::cancelled, "stopped before the tile was drawn"};
        case TileEnd::unresolved_overlap:
            return Error{ErrorCode::unresolved_overlap,
                         program_->overlap_message(
                             *scene_, std::span(drawn.overlapping).first(drawn.overlapping_count))};
        }
        const TileCounts& n = drawn.counts;
        result.rays = {.camera = n.camera,
                       .reflected = n.reflected,
                       .refracted = n.refracted,
                       .shadow = n.shadow,
                       .box_tests = n.box_tests,
                       .form_tests = n.form_tests,
                       .shaded = n.shaded,
                       .skipped_pixels = n.skipped_pixels,
                       .truncated_pixels = n.truncated_pixels};
        return result;
    }

private:
    static bool report(void* owner, std::uint64_t rays) {
        auto& control = *static_cast<RenderControl*>(owner);
        control.rays.fetch_add(rays, std::memory_order_relaxed);
        return !control.stop.load(std::memory_order_relaxed);
    }

    Result<const KernelEntry*> entry_;
    std::shared_ptr<const Scene> scene_;
    std::unique_ptr<const Program> program_;
};

std::shared_ptr<const CompiledScene> compile_with(Result<const KernelEntry*> entry,
                                                  std::shared_ptr<const Scene> scene,
                                                  const SolidLimits& limits) {
    auto program = Program::compile(*scene, limits);
    if (!program)
        return nullptr;
    return std::make_shared<const KernelScene>(std::move(entry), std::move(scene),
                                               std::move(program));
}

} // namespace

std::shared_ptr<const CompiledScene> compile(std::shared_ptr<const Scene> scene) {
    return compile_with(chosen_entry(), std::move(scene), {});
}

std::shared_ptr<const CompiledScene> compile_for(const KernelEntry& entry,
                                                 std::shared_ptr<const Scene> scene,
                                                 const SolidLimits& limits) {
    return compile_with(&entry, std::move(scene), limits);
}

Result<std::string> instruction_set() {
    const Result<const KernelEntry*> entry = chosen_entry();
    if (!entry)
        return entry.error();
    return std::string((*entry)->isa);
}

} // namespace fraja::kernel
