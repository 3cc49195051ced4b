// Translations that trees which equalities couple have in common: what nothing holds, as a linkage
// in space, goes in three directions, one on a carriage along its rail, one on the ground in none.
//
// A translation turns no row, and what the rows of the trees exchange does not change its momentum.
// So how fast a linkage turns, and what its energy has to be made up for, is a matter of the motion
// beside it (coupled_energy.hpp); all the same whether its carriage stands or goes at 5 m/s.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

inline constexpr int kDirections = 3;

class CommonTranslations {
 public:
  // Of trees coupled by equality rows, that have one first tree (coupled_trees.hpp).
  void find(const mjModel_* model, const mjData_* d, const Rows& rows, const Trees& trees,
            const std::vector<int>& first_tree);
  // How many directions the trees of a first one have in common.
  int count(int first) const { return count_[first]; }
  // Whether any trees have the one of this number.
  bool any(int direction) const { return any_[direction]; }
  // The motion of all trees at 1 m/s along that direction of theirs, by motion coordinate; 0 where
  // they have none.
  const std::vector<double>& motion(int direction) const { return motion_[direction]; }

 private:
  // What the first tree could do alone: unit vectors of the world; count -1 where nothing asks.
  struct Candidates {
    int count = -1;
    std::array<double, 3 * kDirections> direction{};
  };
  void find_common(int direction, const mjModel_* model, const mjData_* d, const Rows& rows,
                   const Trees& trees, const std::vector<int>& first_tree);

  std::vector<int> count_;              // by first tree
  std::vector<Candidates> candidates_;  // by the same
  std::vector<char> is_common_;         // by the same, of one direction
  std::array<bool, kDirections> any_{};
  std::array<std::vector<double>, kDirections> motion_;
};

}  // namespace dashpot
