// Columns of dense matrices in blocks of several lanes, each lane with a sum of its own: one sum
// after the other would wait for the last addition. The order of every sum stays that of one lane.

#pragma once

#include <type_traits>

#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

// Two additions a cycle that take three or four cycles each ask for six to eight sums; six and what
// goes into them fit into sixteen registers.
inline constexpr int kMostLanesOfBlock = 6;

// Calls visit(first, width) for blocks of width() lanes that cover `count` numbers, a multiple of
// kLanes, each block from the number `first` on.
template <typename Visit>
[[gnu::always_inline]] static inline void for_each_block(int count, const Visit& visit) {
  for (int first = 0; first < count;) {
    const int lanes = (count - first) / kLanes;
    const int blocks = (lanes + kMostLanesOfBlock - 1) / kMostLanesOfBlock;
    const int width = (lanes + blocks - 1) / blocks;
    static_assert(kMostLanesOfBlock == 6);
    switch (width) {
      case 1:
        visit(first, std::integral_constant<int, 1>{});
        break;
      case 2:
        visit(first, std::integral_constant<int, 2>{});
        break;
      case 3:
        visit(first, std::integral_constant<int, 3>{});
        break;
      case 4:
        visit(first, std::integral_constant<int, 4>{});
        break;
      case 5:
        visit(first, std::integral_constant<int, 5>{});
        break;
      default:
        visit(first, std::integral_constant<int, 6>{});
    }
    first += width * kLanes;
  }
}

// sum += scale * the block of `column`.
template <int Width>
[[gnu::always_inline]] static inline void add_scaled(const double* column, double scale,
                                                     Lanes (&sum)[Width]) {
  for (int i = 0; i < Width; ++i) sum[i] += load_lanes(column + i * kLanes) * scale;
}

template <int Width>
[[gnu::always_inline]] static inline void load_block(const double* values, Lanes (&block)[Width]) {
  for (int i = 0; i < Width; ++i) block[i] = load_lanes(values + i * kLanes);
}

template <int Width>
[[gnu::always_inline]] static inline void store_block(const Lanes (&block)[Width], double* values) {
  for (int i = 0; i < Width; ++i) store_lanes(block[i], values + i * kLanes);
}

}  // namespace dashpot
