// Four numbers at a time: the micro-steps work on four contacts at once, one in each lane.
//
// Lanes never mix (no sums across them), so results do not depend on how wide the processor's
// vectors are. GCC's and Clang's vector extension; everything here is inlined into functions that
// are compiled for several instruction sets.

#pragma once

#include <cmath>
#include <cstring>

namespace dashpot {

inline constexpr int kLanes = 4;

// The next multiple of it.
constexpr int padded(int count) { return (count + kLanes - 1) / kLanes * kLanes; }

// The alignment is spelled out: without it, it would depend on the instruction set compiled for.
typedef double Lanes __attribute__((vector_size(kLanes * sizeof(double)), aligned(32)));
typedef long long LaneMask __attribute__((vector_size(kLanes * sizeof(long long)), aligned(32)));
static_assert(alignof(Lanes) == kLanes * sizeof(double));

[[gnu::always_inline]] inline Lanes load_lanes(const double* values) {
  Lanes lanes;
  std::memcpy(&lanes, values, sizeof lanes);
  return lanes;
}

[[gnu::always_inline]] inline void store_lanes(const Lanes& lanes, double* values) {
  std::memcpy(values, &lanes, sizeof lanes);
}

[[gnu::always_inline]] inline Lanes all_lanes(double value) { return value - Lanes{}; }

// Of two, b where either is no number.
[[gnu::always_inline]] inline Lanes max_lanes(const Lanes& a, const Lanes& b) {
  return a > b ? a : b;
}

[[gnu::always_inline]] inline Lanes min_lanes(const Lanes& a, const Lanes& b) {
  return a < b ? a : b;
}

[[gnu::always_inline]] inline Lanes root_lanes(const Lanes& a) {
  return Lanes{std::sqrt(a[0]), std::sqrt(a[1]), std::sqrt(a[2]), std::sqrt(a[3])};
}

[[gnu::always_inline]] inline bool all_of(const LaneMask& mask) {
  return (mask[0] & mask[1] & mask[2] & mask[3]) != 0;
}

[[gnu::always_inline]] inline bool any_of(const LaneMask& mask) {
  return (mask[0] | mask[1] | mask[2] | mask[3]) != 0;
}

// Rows become columns: row[i] holds (x, y, z, 0) of lane i before, column j of all lanes after.
[[gnu::always_inline]] inline void transpose(Lanes (&row)[kLanes]) {
  const Lanes a = __builtin_shufflevector(row[0], row[1], 0, 4, 2, 6);
  const Lanes b = __builtin_shufflevector(row[0], row[1], 1, 5, 3, 7);
  const Lanes c = __builtin_shufflevector(row[2], row[3], 0, 4, 2, 6);
  const Lanes d = __builtin_shufflevector(row[2], row[3], 1, 5, 3, 7);
  row[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
  row[1] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
  row[2] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
  row[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

}  // namespace dashpot
