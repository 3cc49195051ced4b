// The rows of an island as blocks of four groups (lane_flow.hpp), in slices that threads take.
//
// Groups with the same kind of Jacobian and law follow one another in the order of the island. A
// slice is an equal share of the blocks of every kind. What its rows apply to trees goes to arrays
// of its own, which are summed tree by tree in the order of slices; how many there are goes by the
// number of groups alone, so sums do not depend on who computes them.

#pragma once

#include <array>
#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/solve/sweeps.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// The groups of a block, one in each lane.
struct BlockGroups {
  std::array<int, kLanes> group{};
  std::array<int, kLanes> values{};  // of sparse rows: where those of the lane begin
  int count = 0;
};
// All blocks of one kind.
template <typename Jacobian, typename Law>
struct Blocks {
  std::vector<BlockGroups> groups;
  std::vector<Block<Jacobian, Law>> block;  // of these groups, at least
  int count = 0;                            // of groups, and blocks in use
};

// What the rows of an island did, J.
struct IslandWork {
  EnergyShares work, recovery_input;
};

// Keeps its arrays from one island and step to the next.
class IslandBlocks {
 public:
  // Fills the blocks from `rows` and `data`, for micro-steps of `h` (s).
  void pack(const Rows& rows, const Trees& trees, const Island& island, double h,
            double recovery_speed, const RowData& data, Team& team);
  // Writes what has become of the rows to `data`, all but their work.
  IslandWork unpack(const Rows& rows, RowData& data, Team& team) const;

  static bool has_slices(const Island& island);
  int slices() const { return slices_; }
  // The slices but the first that act on a tree, by bit.
  unsigned other_slices(int tree) const { return slices_ > 1 ? of_tree_[tree] >> 1 : 0; }

  // The blocks of a slice, for sweeps.
  const BlockRanges& ranges(int slice) const { return ranges_[slice]; }

 private:
  // The first block of a slice.
  template <typename List>
  int begin(const List& list, int slice) const {
    return slice == 0 ? 0 : slice == slices_ ? list.count : list.count * slice / slices_;
  }
  void sort(const Rows& rows, const Island& island);
  void find_slices_of_trees(const Rows& rows, int tree_count);
  void find_ranges();

  OfEveryKind<Blocks> blocks_;
  int slices_ = 1;
  std::vector<BlockRanges> ranges_;  // by slice
  std::vector<unsigned> of_tree_;    // slices that act on it, by bit; of islands of several slices
  AlignedDoubles sparse_values_;     // what SparseLanes point to: zeros, for lanes to spare, first
  std::vector<int> sparse_starts_;   // the same of their runs, one for each four values
};

}  // namespace dashpot
