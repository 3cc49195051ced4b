// Four numbers at a time: the micro-steps work on four contacts at once, one in each lane.
//
// Lanes never mix (no sums across them), so results do not depend on how wide the processor's
// vectors are. They are one vector, or two, alike in memory, where no processor has wider ones, and
// in a file that defines DASHPOT_LANES_OF_HALVES. Everything is inlined, and static, so that every
// file has it as compiled for its own instruction set.

#pragma once

#if defined(DASHPOT_LANES_OF_HALVES) || !defined(__x86_64__)
#include "dashpot/lanes/half_lanes.hpp"
#else
#include "dashpot/lanes/whole_lanes.hpp"
#endif

namespace dashpot {

inline constexpr int kLanes = 4;
static_assert(sizeof(Lanes) == kLanes * sizeof(double) && alignof(Lanes) == sizeof(Lanes));
static_assert(sizeof(LaneMask) == sizeof(Lanes) && alignof(LaneMask) == alignof(Lanes));

// The next multiple of it.
constexpr int padded(int count) { return (count + kLanes - 1) / kLanes * kLanes; }

// Of two, b where either is no number.
[[gnu::always_inline]] static inline Lanes max_lanes(const Lanes& a, const Lanes& b) {
  return select(a > b, a, b);
}

[[gnu::always_inline]] static inline Lanes min_lanes(const Lanes& a, const Lanes& b) {
  return select(a < b, a, b);
}

}  // namespace dashpot
