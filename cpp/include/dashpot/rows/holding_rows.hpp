// Rows that hold a tree against the ground between steps, and what they leave of velocity changes.
//
// What smooth forces gain within a step (trapezoid.hpp) moves a tree only as far
// as its rows let it: a foot on the floor bears what the spring of its leg gains. Of a change k of
// velocity, rows J with J k = 0 leave, after the least change of v'H v / 2,
//
//     k  -  inv(H) J' inv(J inv(H) J') J k .
//
// In coordinates z in which H is 1 it is what is orthogonal to all rows. Rows that say the same, as
// corners of one sole do, count once.
//
// What they take, rows have borne, and that is part of their forces. The impulses p with
//
//     J' p = -H (what was taken)
//
// are unique but for such rows; these share so that sum w p^2 is least, w = diag(J inv(H) J').
//
// A row holds if it is compressed at the end of a step, its friction if it sticks, and if its
// spring is too stiff for the step to see it swing, K w H^2 > 1. Rows between two trees hold
// neither against the ground. Nor does a row hold what hits it: that is thrown back with its whole
// velocity, whatever smooth forces gain meanwhile. A hit is where the spring, compressed by x,
// swings farther about where the load b of smooth forces presses it, x = -b / (K w), than that load
// makes it in two steps,
//
//     u^2 + (K w x + b)^2 / (K w)  >  (2 b H)^2,      u: gap rate,
//
// and faster than kHitSpeed (hit.hpp). To book what the spring of a leg gains within the step as
// borne by a contact that throws its foot back gave the foot a fifth of its energy in a hit.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class HoldingRows {
 public:
  // Finds the rows that held at the end of the last step. Needs inv(H) of trees on which rows act.
  void find_at_start(const StepView& step, const Rows& rows, const RowData& data,
                     const Trees& trees);

  // Whether any holds a tree, which is no free body.
  bool hold(int tree) const { return count_[tree] > 0; }
  // Takes from `change`, all motion coordinates of a tree, what its rows bar. `weight`: with which
  // it adds to what they have borne; find_at_start() and forget_borne() set that to nothing.
  void bar(const Trees& trees, int tree, double* change, double weight);
  void forget_borne();
  // Adds to `impulse`, by row, `scale` times what those of a tree have borne.
  void add_borne(int tree, double scale, std::vector<double>& impulse);

 private:
  void reset(const Trees& trees);
  // `stiffness`: of every row of the group.
  void add(const Rows& rows, const Trees& trees, const RowGroup& group, const double* stiffness,
           bool sticks, double length);
  void add_row(int tree, int row, double inverse_mass);
  // `share`: of each combination in x.
  void remove(int tree, int n, double* x, double* share) const;

  // A row of a tree as a sum of the combinations up to it: the first of its coefficients, of which
  // one that says nothing new has one less than there are combinations.
  struct Sum {
    int row, first, count;
    double inverse_mass;
  };
  struct OfTree {
    AlignedDoubles basis;  // combinations, each over all coordinates of the tree
    std::vector<Sum> sums;
    std::vector<double> coefficients;
    std::vector<double> borne;  // share of each combination in what was taken
  };
  void share_borne(const OfTree& held, double scale, std::vector<double>& impulse);

  // By tree, combinations of its rows that are orthonormal in the coordinates in which H is 1
  // (MassWeighted): how many there are, and, where there are any, themselves.
  std::vector<int> count_;
  std::vector<OfTree> held_;
  AlignedDoubles row_;
  std::vector<double> share_;          // of each combination
  std::vector<double> rest_, square_;  // of one tree
};

}  // namespace dashpot
