#include "common/render/kernel/render.hpp"

#include "common/render/cut_level.hpp"
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/program.hpp"

#include <span>
#include <utility>
#include <vector>

namespace fraja::kernel {
namespace {

class KernelScene final : public CompiledScene {
public:
    KernelScene(Result<const KernelEntry*> entry, std::shared_ptr<const Scene> scene,
                std::unique_ptr<const Program> program)
        : CompiledScene(*scene), entry_(std::move(entry)), scene_(std::move(scene)),
          program_(std::move(program)) {}

    Result<DrawnBlock> draw_samples(const RenderSettings& settings, const SampleBlock& block,
                                    RenderControl& control) const override {
        if (!entry_)
            return entry_.error();
        const auto or_null = [](auto span) { return span.empty() ? nullptr : span.data(); };
        const Rgb cut = cut_level(scene_->world, settings);
        const BlockResult drawn = (*entry_)->draw_block(
            program_->tables(), {.depth = settings.depth, .cut = {cut.x, cut.y, cut.z}},
            {.count = static_cast<std::uint32_t>(block.x.size()),
             .x = block.x.data(),
             .y = block.y.data(),
             .rgb = block.rgb.data(),
             .lost = or_null(block.lost),
             .cut = or_null(block.cut),
             .paths = or_null(block.paths),
             .rays = block.rays.data()},
            {&control, &report});
        if (const auto good = to_the_end(drawn); !good)
            return good.error();
        // From weight to the light that it may have been.
        const Rgb light = all_light(scene_->world);
        for (std::size_t i = 0; i < block.cut.size(); i += 3)
            for (std::size_t c = 0; c < 3; ++c)
                block.cut[i + c] *= light[static_cast<glm::length_t>(c)];
        return DrawnBlock{
            .rays = drawn.counts, .skipped = drawn.skipped, .budget_spent = drawn.budget_spent};
    }

    Result<RayCounts> find_first_hits(const FirstHitBlock& block,
                                      RenderControl& control) const override {
        if (!entry_)
            return entry_.error();
        std::vector<TableHit> hits(block.x.size());
        const BlockResult found =
            (*entry_)->find_first_hits(program_->tables(),
                                       {.count = static_cast<std::uint32_t>(block.x.size()),
                                        .x = block.x.data(),
                                        .y = block.y.data(),
                                        .hits = hits.data()},
                                       {&control, &report});
        if (const auto good = to_the_end(found); !good)
            return good.error();
        const double* const center = program_->tables().center;
        for (std::size_t i = 0; i < hits.size(); ++i) {
            const auto& [place, normal, what] = hits[i];
            if (what != none)
                block.hits[i] = {{place[0] + center[0], place[1] + center[1], place[2] + center[2]},
                                 {normal[0], normal[1], normal[2]},
                                 static_cast<std::uint32_t>(as_size(program_->solid_of(what))) + 1};
        }
        return found.counts;
    }

private:
    [[nodiscard]] Result<void> to_the_end(const BlockResult& block) const {
        switch (block.end) {
        case BlockEnd::drawn:
            return {};
        case BlockEnd::stopped:
            return Error{ErrorCode::cancelled, "stopped before the tile was drawn"};
        case BlockEnd::unresolved_overlap:
            return Error{ErrorCode::unresolved_overlap,
                         program_->overlap_message(
                             *scene_, std::span(block.overlapping).first(block.overlapping_count))};
        }
        return {};
    }

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
