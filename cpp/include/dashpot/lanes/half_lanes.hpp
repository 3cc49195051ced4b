// The lanes of lanes.hpp as pairs of vectors of two numbers, for processors whose vectors hold no
// more (SSE2, NEON): there GCC takes comparisons and selections of four into single numbers, with
// branches, and passes halves through memory. Included by lanes.hpp.

#pragma once

#if defined(__SSE2__)
#include <emmintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

#include <cmath>
#include <cstring>

namespace dashpot {

typedef double HalfLanes __attribute__((vector_size(16)));
typedef long long HalfMask __attribute__((vector_size(16)));

struct alignas(32) LaneMask {
  HalfMask low, high;

  [[gnu::always_inline]] long long operator[](int lane) const {
    return lane < 2 ? low[lane] : high[lane - 2];
  }
  [[gnu::always_inline]] long long& operator[](int lane) {
    return reinterpret_cast<long long*>(this)[lane];
  }
};

struct alignas(32) Lanes {
  HalfLanes low, high;

  Lanes() = default;
  [[gnu::always_inline]] Lanes(const HalfLanes& first_two, const HalfLanes& last_two)
      : low(first_two), high(last_two) {}
  [[gnu::always_inline]] Lanes(double value) : Lanes(value, value, value, value) {}
  [[gnu::always_inline]] Lanes(double a, double b, double c, double d) : low{a, b}, high{c, d} {}

  [[gnu::always_inline]] double operator[](int lane) const {
    return lane < 2 ? low[lane] : high[lane - 2];
  }
  [[gnu::always_inline]] double& operator[](int lane) {
    return reinterpret_cast<double*>(this)[lane];
  }
};

// Half by half, since copies of a whole one go through memory.
[[gnu::always_inline]] static inline Lanes load_lanes(const double* values) {
  Lanes lanes;
  std::memcpy(&lanes.low, values, sizeof lanes.low);
  std::memcpy(&lanes.high, values + 2, sizeof lanes.high);
  return lanes;
}

[[gnu::always_inline]] static inline void store_lanes(const Lanes& lanes, double* values) {
  std::memcpy(values, &lanes.low, sizeof lanes.low);
  std::memcpy(values + 2, &lanes.high, sizeof lanes.high);
}

[[gnu::always_inline]] static inline Lanes all_lanes(double value) { return value; }

[[gnu::always_inline]] static inline Lanes operator-(const Lanes& a) { return {-a.low, -a.high}; }

// Operators of both halves, and those that assign.
#define DASHPOT_BY_HALVES(Result, Operand, op)                                                  \
  [[gnu::always_inline]] static inline Result operator op(const Operand& a, const Operand& b) { \
    return {a.low op b.low, a.high op b.high};                                                  \
  }
#define DASHPOT_ASSIGN(Operand, op)                                                            \
  [[gnu::always_inline]] static inline Operand& operator op##=(Operand& a, const Operand& b) { \
    return a = a op b;                                                                         \
  }
DASHPOT_BY_HALVES(Lanes, Lanes, +)
DASHPOT_BY_HALVES(Lanes, Lanes, -)
DASHPOT_BY_HALVES(Lanes, Lanes, *)
DASHPOT_BY_HALVES(Lanes, Lanes, /)
DASHPOT_BY_HALVES(LaneMask, Lanes, <)
DASHPOT_BY_HALVES(LaneMask, Lanes, <=)
DASHPOT_BY_HALVES(LaneMask, Lanes, >)
DASHPOT_BY_HALVES(LaneMask, Lanes, >=)
DASHPOT_BY_HALVES(LaneMask, Lanes, ==)
DASHPOT_BY_HALVES(LaneMask, Lanes, !=)
DASHPOT_BY_HALVES(LaneMask, LaneMask, &)
DASHPOT_BY_HALVES(LaneMask, LaneMask, |)
DASHPOT_ASSIGN(Lanes, +)
DASHPOT_ASSIGN(Lanes, -)
DASHPOT_ASSIGN(Lanes, *)
DASHPOT_ASSIGN(LaneMask, |)
#undef DASHPOT_BY_HALVES
#undef DASHPOT_ASSIGN

[[gnu::always_inline]] static inline LaneMask operator~(const LaneMask& a) {
  return {~a.low, ~a.high};
}

[[gnu::always_inline]] static inline HalfLanes select_half(const HalfMask& mask, const HalfLanes& a,
                                                           const HalfLanes& b) {
  return mask ? a : b;
}

[[gnu::always_inline]] static inline Lanes select(const LaneMask& mask, const Lanes& a,
                                                  const Lanes& b) {
  return {select_half(mask.low, a.low, b.low), select_half(mask.high, a.high, b.high)};
}

[[gnu::always_inline]] static inline HalfLanes root_half(const HalfLanes& a) {
#if defined(__SSE2__)
  return _mm_sqrt_pd(a);
#elif defined(__aarch64__)
  return vsqrtq_f64(a);
#else
  return HalfLanes{std::sqrt(a[0]), std::sqrt(a[1])};
#endif
}

[[gnu::always_inline]] static inline Lanes root_lanes(const Lanes& a) {
  return {root_half(a.low), root_half(a.high)};
}

[[gnu::always_inline]] static inline bool all_of(const LaneMask& mask) {
  const HalfMask both = mask.low & mask.high;
  return (both[0] & both[1]) != 0;
}

[[gnu::always_inline]] static inline bool any_of(const LaneMask& mask) {
  const HalfMask either = mask.low | mask.high;
  return (either[0] | either[1]) != 0;
}

[[gnu::always_inline]] static inline void transpose_halves(const HalfLanes& a, const HalfLanes& b,
                                                           HalfLanes& first, HalfLanes& second) {
  first = __builtin_shufflevector(a, b, 0, 2);
  second = __builtin_shufflevector(a, b, 1, 3);
}

// Rows become columns: row[i] holds (x, y, z, 0) of lane i before, column j of all lanes after.
[[gnu::always_inline]] static inline void transpose(Lanes (&row)[4]) {
  Lanes column[4];
  transpose_halves(row[0].low, row[1].low, column[0].low, column[1].low);
  transpose_halves(row[2].low, row[3].low, column[0].high, column[1].high);
  transpose_halves(row[0].high, row[1].high, column[2].low, column[3].low);
  transpose_halves(row[2].high, row[3].high, column[2].high, column[3].high);
  for (int i = 0; i < 4; ++i) row[i] = column[i];
}

// (x, y, z, _) becomes (y, z, x, _).
[[gnu::always_inline]] static inline Lanes yzx(const Lanes& a) {
  return {__builtin_shufflevector(a.low, a.high, 1, 2),
          __builtin_shufflevector(a.low, a.high, 0, 3)};
}

}  // namespace dashpot
