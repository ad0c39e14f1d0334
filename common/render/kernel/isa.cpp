// Compiled once per instruction set; FRAJA_KERNEL_ENTRY is the one name that leaves the object.
#include "common/render/kernel/hits.hpp"
#include "common/render/kernel/light.hpp"
#include "common/render/kernel/probe.hpp"
#include "common/render/kernel/samples.hpp"
#include "common/render/kernel/tracer.hpp"
#include "common/render/kernel/view.hpp"

#if !defined(FRAJA_KERNEL_ENTRY) || !defined(FRAJA_KERNEL_ISA)
#error "FRAJA_KERNEL_ENTRY and FRAJA_KERNEL_ISA say what is being compiled"
#endif

namespace fraja::kernel {
namespace {

TileResult render_tile(const Tables& tables, const TileJob& job, const TileControl& control) {
    return TileTracer(tables, job, control).draw();
}

} // namespace
} // namespace fraja::kernel

extern "C" const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY;
const fraja::kernel::KernelEntry FRAJA_KERNEL_ENTRY = {FRAJA_KERNEL_ISA, fraja::kernel::render_tile,
                                                       fraja::kernel::find_hits};
