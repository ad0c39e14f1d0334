// Compiled once per instruction set; FRAJA_KERNEL_ENTRY is the one name that leaves the object.
#include "common/render/kernel/hits.hpp"
#include "common/render/kernel/light.hpp"
#include "common/render/kernel/probe.hpp"
#include "common/render/kernel/samples.hpp"
#include "common/render/kernel/tracer.hpp"
#include "common/render/kernel/view.hpp"

#include <memory>

#if !defined(FRAJA_KERNEL_ENTRY) || !defined(FRAJA_KERNEL_ISA)
#error "FRAJA_KERNEL_ENTRY and FRAJA_KERNEL_ISA say what is being compiled"
#endif

namespace fraja::kernel {
namespace {

/// A thread's tracer stays for its next tile: its buffers cost a small tile's time.
TileResult render_tile(const Tables& tables, const TileJob& job, const TileControl& control) {
    thread_local std::unique_ptr<TileTracer> tracer;
    if (!tracer || tracer->scene() != tables.scene)
        tracer = std::make_unique<TileTracer>(tables);
    return tracer->draw(job, control);
}

} // namespace
} // namespace fraja::kernel

extern "C" const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY;
const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY = {FRAJA_KERNEL_ISA, fraja::kernel::render_tile,
                                                       fraja::kernel::find_hits};
