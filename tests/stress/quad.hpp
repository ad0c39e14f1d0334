// Quadruple precision: what the stress suite takes for the truth.
#pragma once

#include "common/math/vec.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::stress {

using fraja::dot;
using fraja::length; // beside those of Quad3

__extension__ using Quad = __float128; // 113 bits

inline Quad root(Quad x) {
    if (!(x > 0))
        return 0;
    Quad r = std::sqrt(static_cast<double>(x));
    for (int i = 0; i < 3; ++i) // each doubles the digits
        r = (r + x / r) / 2;
    return r;
}
inline Quad magnitude(Quad x) {
    return x < 0 ? -x : x;
}

struct Quad3 {
    Quad x = 0, y = 0, z = 0;
};
inline Quad3 quad(const Vec3& v) {
    return {v.x, v.y, v.z};
}
inline Quad3 operator+(const Quad3& a, const Quad3& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Quad3 operator-(const Quad3& a, const Quad3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Quad3 operator*(Quad s, const Quad3& v) {
    return {s * v.x, s * v.y, s * v.z};
}
inline Quad dot(const Quad3& a, const Quad3& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Quad length(const Quad3& v) {
    return root(dot(v, v));
}
inline Quad3 unit(const Quad3& v) {
    return (1 / length(v)) * v;
}
/// The part of v across a direction, which need not be unit.
inline Quad3 across(const Quad3& v, const Quad3& dir) {
    return v - (dot(v, dir) / dot(dir, dir)) * dir;
}

/// Half a unit in the last place of 1: what a rounding to double may cost.
inline constexpr double eps = 0x1p-53;

} // namespace fraja::stress
