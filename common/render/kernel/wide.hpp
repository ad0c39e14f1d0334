// Wide numbers: as many doubles as the instruction set has lanes, with the operations of one.
//
// Only for the files that are compiled once per instruction set (isa.cpp). Every operation is the
// IEEE one in each lane, so that no bit depends on how many lanes there are.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace fraja::kernel {
namespace { // each instruction set has its own

#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define FRAJA_AVX512
constexpr int lanes = 8;
#elif defined(__AVX2__)
constexpr int lanes = 4;
#else
constexpr int lanes = 2;
#endif

using Wide = double __attribute__((vector_size(8 * lanes)));
using WideInt = std::int64_t __attribute__((vector_size(8 * lanes)));
using Mask = WideInt; ///< each lane 0 or -1

#define FRAJA_WIDE [[gnu::always_inline]] inline

FRAJA_WIDE Wide all_lanes(double x) {
    return x - Wide{};
}
FRAJA_WIDE WideInt all_lanes(std::int64_t x) {
    return x - WideInt{};
}
FRAJA_WIDE Wide load(const double* from) {
    Wide w;
    std::memcpy(&w, from, sizeof w);
    return w;
}
FRAJA_WIDE WideInt load(const std::int64_t* from) {
    WideInt w;
    std::memcpy(&w, from, sizeof w);
    return w;
}
FRAJA_WIDE void store(double* to, Wide w) {
    std::memcpy(to, &w, sizeof w);
}
FRAJA_WIDE void store(std::int64_t* to, WideInt w) {
    std::memcpy(to, &w, sizeof w);
}
FRAJA_WIDE Wide select(Mask m, Wide yes, Wide no) {
    return m ? yes : no;
}
FRAJA_WIDE WideInt select(Mask m, WideInt yes, WideInt no) {
    return m ? yes : no;
}

/// One bit per lane, of those that are set.
FRAJA_WIDE unsigned bits_of(Mask m) {
#if defined(FRAJA_AVX512)
    return _mm512_movepi64_mask(reinterpret_cast<__m512i>(m));
#elif defined(__AVX2__)
    return static_cast<unsigned>(_mm256_movemask_pd(reinterpret_cast<__m256d>(m)));
#elif defined(__SSE2__)
    return static_cast<unsigned>(_mm_movemask_pd(reinterpret_cast<__m128d>(m)));
#else
    unsigned bits = 0;
    for (int i = 0; i < lanes; ++i)
        bits |= m[i] ? 1u << i : 0u;
    return bits;
#endif
}
FRAJA_WIDE bool any(Mask m) {
    return bits_of(m) != 0;
}
FRAJA_WIDE Mask mask_of(unsigned bits) {
    WideInt lane_bit;
    for (int i = 0; i < lanes; ++i)
        lane_bit[i] = 1 << i;
    return (all_lanes(std::int64_t{bits}) & lane_bit) != 0;
}
constexpr unsigned every_lane = (1u << lanes) - 1;

FRAJA_WIDE Wide square_root(Wide x) {
#if defined(FRAJA_AVX512)
    return reinterpret_cast<Wide>(_mm512_maskz_sqrt_pd(0xff, reinterpret_cast<__m512d>(x)));
#elif defined(__AVX2__)
    return reinterpret_cast<Wide>(_mm256_sqrt_pd(reinterpret_cast<__m256d>(x)));
#elif defined(__SSE2__)
    return reinterpret_cast<Wide>(_mm_sqrt_pd(reinterpret_cast<__m128d>(x)));
#else
    for (int i = 0; i < lanes; ++i)
        x[i] = __builtin_sqrt(x[i]);
    return x;
#endif
}
FRAJA_WIDE Wide round_down(Wide x) {
#if defined(FRAJA_AVX512)
    return reinterpret_cast<Wide>(
        _mm512_maskz_roundscale_pd(0xff, reinterpret_cast<__m512d>(x), 0x09));
#elif defined(__AVX2__)
    return reinterpret_cast<Wide>(_mm256_floor_pd(reinterpret_cast<__m256d>(x)));
#elif defined(__SSE4_1__)
    return reinterpret_cast<Wide>(_mm_floor_pd(reinterpret_cast<__m128d>(x)));
#else
    for (int i = 0; i < lanes; ++i)
        x[i] = __builtin_floor(x[i]);
    return x;
#endif
}
/// Towards zero.
FRAJA_WIDE Wide truncated(Wide x) {
    const Wide down = round_down(x < 0 ? -x : x);
    return x < 0 ? -down : down;
}
FRAJA_WIDE Wide magnitude(Wide x) {
    return reinterpret_cast<Wide>(reinterpret_cast<WideInt>(x) & INT64_MAX);
}
/// b where a is no number.
FRAJA_WIDE Wide greater(Wide a, Wide b) {
    return a > b ? a : b;
}
FRAJA_WIDE Wide lesser(Wide a, Wide b) {
    return a < b ? a : b;
}

struct Wide3 {
    Wide x, y, z;
};
FRAJA_WIDE Wide3 all_lanes3(const double (&v)[3]) {
    return {all_lanes(v[0]), all_lanes(v[1]), all_lanes(v[2])};
}
FRAJA_WIDE Wide3 operator+(Wide3 a, Wide3 b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
FRAJA_WIDE Wide3 operator-(Wide3 a, Wide3 b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
FRAJA_WIDE Wide3 operator-(Wide3 a) {
    return {-a.x, -a.y, -a.z};
}
FRAJA_WIDE Wide3 operator*(Wide s, Wide3 v) {
    return {s * v.x, s * v.y, s * v.z};
}
FRAJA_WIDE Wide3 operator*(Wide3 a, Wide3 b) {
    return {a.x * b.x, a.y * b.y, a.z * b.z};
}
FRAJA_WIDE Wide dot(Wide3 a, Wide3 b) {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}
FRAJA_WIDE Wide3 cross(Wide3 a, Wide3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
FRAJA_WIDE Wide3 select(Mask m, Wide3 yes, Wide3 no) {
    return {select(m, yes.x, no.x), select(m, yes.y, no.y), select(m, yes.z, no.z)};
}
FRAJA_WIDE Wide3 normalized(Wide3 v) {
    return (1.0 / square_root(dot(v, v))) * v;
}

// ---------------------------------------------------------------------- error-free transformations

/// An unevaluated sum, |low| <= ulp(high) / 2.
struct Wide2 {
    Wide high, low;
};
FRAJA_WIDE Wide2 two_sum(Wide a, Wide b) { // Knuth
    const Wide s = a + b;
    const Wide bb = s - a;
    return {s, (a - (s - bb)) + (b - bb)};
}
FRAJA_WIDE Wide2 two_difference(Wide a, Wide b) {
    return two_sum(a, -b);
}
FRAJA_WIDE Wide2 quick_two_sum(Wide a, Wide b) { // |a| >= |b|: Dekker
    const Wide s = a + b;
    return {s, b - (s - a)};
}
/// Where the product neither overflows nor loses bits to underflow, exact; the bits are those of
/// Dekker's product, with or without a fused multiply-add.
FRAJA_WIDE Wide2 two_product(Wide a, Wide b) {
    const Wide p = a * b;
#if defined(FRAJA_AVX512)
    return {p, reinterpret_cast<Wide>(_mm512_fmsub_pd(reinterpret_cast<__m512d>(a),
                                                      reinterpret_cast<__m512d>(b),
                                                      reinterpret_cast<__m512d>(p)))};
#elif defined(__AVX2__) && defined(__FMA__)
    return {p, reinterpret_cast<Wide>(_mm256_fmsub_pd(reinterpret_cast<__m256d>(a),
                                                      reinterpret_cast<__m256d>(b),
                                                      reinterpret_cast<__m256d>(p)))};
#else
    constexpr double splitter = 134217729; // 2^27 + 1
    const Wide sa = splitter * a, sb = splitter * b;
    const Wide ah = sa - (sa - a), bh = sb - (sb - b);
    const Wide al = a - ah, bl = b - bh;
    return {p, ((ah * bh - p) + ah * bl + al * bh) + al * bl};
#endif
}
FRAJA_WIDE Wide2 operator+(Wide2 a, Wide2 b) {
    const Wide2 s = two_sum(a.high, b.high);
    return quick_two_sum(s.high, s.low + (a.low + b.low));
}
FRAJA_WIDE Wide2 operator-(Wide2 a) {
    return {-a.high, -a.low};
}
FRAJA_WIDE Wide2 operator-(Wide2 a, Wide2 b) {
    return a + -b;
}
FRAJA_WIDE Wide2 operator*(Wide2 a, Wide b) {
    const Wide2 p = two_product(a.high, b);
    return quick_two_sum(p.high, p.low + a.low * b);
}
FRAJA_WIDE Wide2 operator*(Wide2 a, Wide2 b) {
    const Wide2 p = two_product(a.high, b.high);
    return quick_two_sum(p.high, p.low + (a.high * b.low + a.low * b.high));
}
FRAJA_WIDE Wide2 operator/(Wide2 a, Wide2 b) {
    const Wide q = a.high / b.high;
    const Wide2 rest = a - b * q;
    return quick_two_sum(q, (rest.high + rest.low) / b.high);
}
/// Of a value that is not negative; 0 gives 0.
FRAJA_WIDE Wide2 square_root(Wide2 a) {
    const Wide s = square_root(a.high);
    const Wide2 rest = a - two_product(s, s);
    const Wide correction = (rest.high + rest.low) / (2 * s);
    return quick_two_sum(s, s > 0 ? correction : Wide{});
}
FRAJA_WIDE Wide rounded(Wide2 a) {
    return a.high + a.low;
}
struct Wide32 {
    Wide2 x, y, z;
};
FRAJA_WIDE Wide32 difference(Wide3 a, Wide3 b) {
    return {two_difference(a.x, b.x), two_difference(a.y, b.y), two_difference(a.z, b.z)};
}
FRAJA_WIDE Wide2 dot(Wide32 a, Wide3 b) {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}
FRAJA_WIDE Wide2 dot(Wide32 a, Wide32 b) {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}
FRAJA_WIDE Wide2 dot2(Wide3 a, Wide3 b) {
    return (two_product(a.x, b.x) + two_product(a.y, b.y)) + two_product(a.z, b.z);
}
/// As good as in twice the precision, then rounded to high + low. T. Ogita, S. Rump, S. Oishi,
/// "Accurate Sum and Dot Product" (2005).
FRAJA_WIDE Wide2 compensated_dot(Wide32 a, Wide3 b) {
    const Wide2 x = two_product(a.x.high, b.x);
    const Wide2 y = two_product(a.y.high, b.y);
    const Wide2 z = two_product(a.z.high, b.z);
    const Wide2 xy = two_sum(x.high, y.high);
    const Wide2 xyz = two_sum(xy.high, z.high);
    const Wide errors = ((x.low + y.low) + z.low) + (xy.low + xyz.low);
    const Wide lows = (a.x.low * b.x + a.y.low * b.y) + a.z.low * b.z;
    return two_sum(xyz.high, errors + lows);
}
/// |v|^2 - 1 of a vector whose length is 1 but for rounding, with most of its digits.
FRAJA_WIDE Wide excess_over_one(Wide3 v) {
    const Wide2 x = two_product(v.x, v.x);
    const Wide2 y = two_product(v.y, v.y);
    const Wide2 z = two_product(v.z, v.z);
    const Wide2 xy = two_sum(x.high, y.high);
    const Wide2 xyz = two_sum(xy.high, z.high);
    return (xyz.high - 1) + (((x.low + y.low) + z.low) + (xy.low + xyz.low));
}
FRAJA_WIDE Wide32 operator-(Wide32 a, Wide32 b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
FRAJA_WIDE Wide32 operator+(Wide32 a, Wide32 b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
FRAJA_WIDE Wide32 operator*(Wide2 s, Wide3 v) {
    return {s * v.x, s * v.y, s * v.z};
}
FRAJA_WIDE Wide32 operator*(Wide2 s, Wide32 v) {
    return {s * v.x, s * v.y, s * v.z};
}
FRAJA_WIDE Wide3 rounded(Wide32 v) {
    return {rounded(v.x), rounded(v.y), rounded(v.z)};
}
FRAJA_WIDE Wide32 exactly(Wide3 v) {
    return {{v.x, Wide{}}, {v.y, Wide{}}, {v.z, Wide{}}};
}

} // namespace
} // namespace fraja::kernel
