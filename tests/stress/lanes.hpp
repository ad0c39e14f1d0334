// The kernel's wide numbers with the same in every lane. In a namespace without a name, as they
// are: each instruction set has its own.
#pragma once

#include "common/math/vec.hpp"
#include "common/render/kernel/wide.hpp"

namespace fraja::stress {
namespace {

kernel::Wide3 in_all_lanes(const Vec3& v) {
    return {kernel::all_lanes(v.x), kernel::all_lanes(v.y), kernel::all_lanes(v.z)};
}

} // namespace
} // namespace fraja::stress
