// Rows that hold a tree against the ground from one step to the next, and what they leave of a
// change of its velocity.
//
// What smooth forces gain within a step (trapezoid.hpp, runge_kutta.hpp) moves a tree only as far
// as its rows let it: a foot on the floor bears what the spring of its leg gains. Of a change k of
// velocity, rows J with J k = 0 leave, after the least change of v'H v / 2,
//
//     k  -  inv(H) J' inv(J inv(H) J') J k .
//
// In coordinates z in which H is 1 it is what is orthogonal to all rows. Rows that say the same, as
// corners of one sole do, count once.
//
// A row holds if it is compressed at the end of a step, its friction if it sticks, and if its
// spring is too stiff for the step to see it swing, K w H^2 > 1. Rows between two trees hold
// neither against the ground.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class HoldingRows {
 public:
  // Finds the rows that held at the end of the last step, of which `matches` tell for the contacts
  // of `rows`; this step has `length` (s). Needs inv(H) of trees on which rows act, as all that
  // follows does.
  void find_at_start(const Rows& rows, const std::vector<ConstraintInput>& constraints,
                     const std::vector<Match>& matches, const Memory& memory, const Trees& trees,
                     double length);
  // Finds those that hold at the end of this step, after its micro-steps; equalities hold too. H is
  // the inertia whose factor the trees have then.
  void find_at_end(const Rows& rows, const RowData& data, const Trees& trees, double length);

  // Whether any holds a tree, which is no free body.
  bool hold(int tree) const { return count_[tree] > 0; }
  // Takes from `change`, all motion coordinates of a tree, what its rows bar.
  void bar(const Trees& trees, int tree, double* change);
  // What they leave of the inverse mass of degree of freedom i of a tree, of diag(inv(H)).
  double free_inverse_mass(const Trees& trees, int tree, int i) const;

 private:
  void reset(const Trees& trees);
  // `stiffness`: of every row of the group. `weighted`: its mass-weighted rows have the present H.
  void add(const Rows& rows, const Trees& trees, size_t group, const double* stiffness, bool sticks,
           double length, bool weighted);
  void add_row(int tree, double inverse_mass);
  void remove(int tree, int n, double* x);

  // By tree, combinations of its rows that are orthonormal in the coordinates in which H is 1
  // (MassWeighted): how many there are, and each over all coordinates of the tree.
  std::vector<int> count_;
  std::vector<AlignedDoubles> basis_;
  AlignedDoubles row_;
  std::vector<double> share_;  // of each combination
};

}  // namespace dashpot
