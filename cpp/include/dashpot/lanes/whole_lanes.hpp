// The lanes of lanes.hpp as one vector of four numbers: GCC's and Clang's vector extension, which
// takes it apart where the processor's vectors are smaller. Included by lanes.hpp.

#pragma once

#if defined(__AVX__)
#include <immintrin.h>
#endif

#include <cmath>
#include <cstring>

namespace dashpot {

// The alignment is spelled out: without it, it would depend on the instruction set compiled for.
typedef double Lanes __attribute__((vector_size(4 * sizeof(double)), aligned(32)));
typedef long long LaneMask __attribute__((vector_size(4 * sizeof(long long)), aligned(32)));
static_assert(alignof(Lanes) == 4 * sizeof(double));

[[gnu::always_inline]] static inline Lanes load_lanes(const double* values) {
  Lanes lanes;
  std::memcpy(&lanes, values, sizeof lanes);
  return lanes;
}

[[gnu::always_inline]] static inline void store_lanes(const Lanes& lanes, double* values) {
  std::memcpy(values, &lanes, sizeof lanes);
}

[[gnu::always_inline]] static inline Lanes all_lanes(double value) { return value - Lanes{}; }

// By lane, a where the mask is set.
[[gnu::always_inline]] static inline Lanes select(const LaneMask& mask, const Lanes& a,
                                                  const Lanes& b) {
  return mask ? a : b;
}

// Compilers leave these to one lane after the other.
#if defined(__AVX__)
[[gnu::always_inline]] static inline Lanes root_lanes(const Lanes& a) { return _mm256_sqrt_pd(a); }

// By lane, from the lowest bit on.
[[gnu::always_inline]] static inline int bits_of(const LaneMask& mask) {
  return _mm256_movemask_pd(reinterpret_cast<__m256d>(mask));
}

[[gnu::always_inline]] static inline bool all_of(const LaneMask& mask) {
  return bits_of(mask) == 0xf;
}

[[gnu::always_inline]] static inline bool any_of(const LaneMask& mask) {
  return bits_of(mask) != 0;
}
#else
[[gnu::always_inline]] static inline Lanes root_lanes(const Lanes& a) {
  return Lanes{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])};
}

[[gnu::always_inline]] static inline bool all_of(const LaneMask& mask) {
  return (mask[0] & mask[1] & mask[2] & mask[3]) != 0;
}

[[gnu::always_inline]] static inline bool any_of(const LaneMask& mask) {
  return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
}
#endif

// Rows become columns: row[i] holds (x, y, z, 0) of lane i before, column j of all lanes after.
[[gnu::always_inline]] static inline void transpose(Lanes (&row)[4]) {
  const Lanes a = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6);
  const Lanes b = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7);
  const Lanes c = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6);
  const Lanes d = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
  row[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
  row[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
  row[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
  row[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

// (x, y, z, _) becomes (y, z, x, _).
[[gnu::always_inline]] static inline Lanes yzx(const Lanes& a) {
  return __builtin_shufflevector(a, a, 1, 2, 0, 3);
}

}  // namespace dashpot
