// Vectors of the scene as the tables hold them.
#pragma once

#include "common/math/vec.hpp"

namespace fraja::kernel {

inline void put(double (&to)[3], const Vec3& v) {
    to[0] = v.x, to[1] = v.y, to[2] = v.z;
}
inline Vec3 vec(const double (&v)[3]) {
    return {v[0], v[1], v[2]};
}

} // namespace fraja::kernel
