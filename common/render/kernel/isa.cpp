// Compiled once per instruction set; FRAJA_KERNEL_ENTRY is the one name that leaves the object.
#include "common/render/kernel/first_hits.hpp"
#include "common/render/kernel/hits.hpp"
#include "common/render/kernel/light.hpp"
#include "common/render/kernel/probe.hpp"
#include "common/render/kernel/samples.hpp"
#include "common/render/kernel/tracer.hpp"
#include "common/render/kernel/view.hpp"

#include <variant>

#if !defined(FRAJA_KERNEL_ENTRY) || !defined(FRAJA_KERNEL_ISA)
#error "FRAJA_KERNEL_ENTRY and FRAJA_KERNEL_ISA say what is being compiled"
#endif

namespace fraja::kernel {
namespace {

// A kernel each; a scene is drawn by the first that has what it needs.
constexpr Features opaque{false, false, false}, opaque_apart{false, false, true};
constexpr Features glass{true, false, false};
constexpr Features everything{true, true, true};

template <Features has>
bool serves(const Tables& tables) {
    return (has.state || !tables.stateful) && (has.composites || tables.leaf_is_surface) &&
           (has.apart || tables.bvh == nullptr);
}

/// f.operator()<has>() with the features of the kernel for a scene.
template <class F>
auto with_features(const Tables& tables, F&& f) {
    if (serves<opaque>(tables))
        return f.template operator()<opaque>();
    if (serves<opaque_apart>(tables))
        return f.template operator()<opaque_apart>();
    if (serves<glass>(tables))
        return f.template operator()<glass>();
    return f.template operator()<everything>();
}

/// A thread's tracer stays for its next block: its buffers cost a small tile's time.
using AnyTracer = std::variant<std::monostate, BlockTracer<opaque>, BlockTracer<opaque_apart>,
                               BlockTracer<glass>, BlockTracer<everything>>;

thread_local AnyTracer kept_tracer;

/// f(the thread's tracer for a scene).
template <class F>
BlockResult with_tracer(const Tables& tables, F&& f) {
    return with_features(tables, [&]<Features has>() {
        auto* tracer = std::get_if<BlockTracer<has>>(&kept_tracer);
        if (tracer == nullptr || tracer->scene() != tables.scene)
            tracer = &kept_tracer.emplace<BlockTracer<has>>(tables);
        return f(*tracer);
    });
}

BlockResult draw_block(const Tables& tables, const SampleJob& job, const Block& block,
                       const DrawControl& control) {
    return with_tracer(tables, [&](auto& tracer) { return tracer.draw(job, block, control); });
}

BlockResult find_first_hits(const Tables& tables, const FirstHits& block,
                            const DrawControl& control) {
    return with_tracer(tables,
                       [&](auto& tracer) { return tracer.find_first_hits(block, control); });
}

Features features_for(const Tables& tables) {
    return with_features(tables, []<Features has>() { return has; });
}

} // namespace
} // namespace fraja::kernel

extern "C" const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY;
const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY = {
    FRAJA_KERNEL_ISA, fraja::kernel::draw_block, fraja::kernel::find_first_hits,
    fraja::kernel::features_for, fraja::kernel::find_hits};
