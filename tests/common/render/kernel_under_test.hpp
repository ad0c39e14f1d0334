// What both kernels promise is tested by the same files, compiled once for each.
#pragma once

#include "common/render/render.hpp"

namespace fraja {

#ifdef FRAJA_TEST_FAST_KERNEL
inline constexpr Kernel kernel_under_test = Kernel::fast;
#else
inline constexpr Kernel kernel_under_test = Kernel::reference;
#endif

} // namespace fraja
