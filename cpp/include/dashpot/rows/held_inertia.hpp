// The inertia of trees that rows hold as springs of compliance R do, factored:
//
//     H + J' inv(R) J .
//
// Each line of the factor begins at the first coordinate that anything couples it to. Chains and
// nets keep theirs short where trees that many rows reach, as a tracked vehicle's hull, are last.

#pragma once

#include <vector>

#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// Row `row` of Rows, which is that of index `of_group` of its group.
struct HeldRow {
  int group = 0, of_group = 0;
  double compliance = 0.0;  // R, above 0
};

// Keeps its arrays from step to step.
class HeldInertia {
 public:
  // Numbers the coordinates of the trees from `first` to `last`, among which are those of all rows.
  void reset(const Rows& rows, const Trees& trees, const int* first, const int* last,
             const std::vector<HeldRow>& held);
  int size() const { return size_; }  // coordinates that move
  double work() const;                // additions that factors take, about

  // Factors it; false where rounding leaves nothing of light bodies beside stiff springs.
  bool factor();
  // Finds the motion of a force, in motion coordinates.
  void solve(const double* force, double* motion);

 private:
  void number(const Trees& trees, const std::vector<HeldRow>& held);
  void read_rows(const std::vector<HeldRow>& held);
  void add_inertia(const Tree& tree);
  double& entry(int i, int j) { return entry_[start_[i] + j - first_[i]]; }

  const Rows* rows_ = nullptr;
  const Trees* trees_ = nullptr;
  int size_ = 0;
  std::vector<int> tree_, reached_by_;     // in the order of numbers; rows, by tree
  std::vector<int> number_, coordinate_;   // by motion coordinate, and the other way round
  std::vector<int> first_, start_;         // of each line, and where its entries begin
  std::vector<int> column_, row_begin_;    // of the rows
  std::vector<double> value_, stiffness_;  // of the rows
  AlignedDoubles entry_, inverse_root_, solution_;
};

}  // namespace dashpot
