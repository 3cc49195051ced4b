// A part of a step whose rows are solved, as all that follows from that sees it.

#pragma once

#include <vector>

#include "dashpot/lanes/aligned.hpp"
#include "dashpot/motion/leapfrog.hpp"
#include "dashpot/motion/trapezoid.hpp"
#include "dashpot/motion/tree_motion.hpp"
#include "dashpot/mujoco/runge_kutta.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;

namespace dashpot {

// By tree, what rows did to it in the part, see RowsOnTree.
struct RowsOnTrees {
  std::vector<char> touched;   // moved it
  std::vector<char> joined;    // moved another one against it
  std::vector<char> held;      // had a position as they moved it
  std::vector<double> unpaid;  // J, work of contacts, because they turn, that no spring paid for
  std::vector<double> lost;    // J, what they gave it and it does not have

  void reset(int trees) {
    for (auto* array : {&touched, &joined, &held}) array->assign(trees, 0);
  }
};

struct SolvedPart {
  mjModel_* model;
  bool is_comfree;
  double length;  // H, s
  const std::vector<ContactInput>& contacts;
  const std::vector<ConstraintInput>& constraints;
  const Rows& rows;
  const RowData& data;
  const RowsOnTrees& on_trees;
  const std::vector<double>&
      recovery;  // by motion coordinate: displacement that equalities recover
  const TreeMotion& motion;
  const Leapfrog& leapfrog;
  const Trapezoid& trapezoid;
  const host::RungeKutta* stages;  // of RK4, null where these move nothing

  // Whether a tree went the way of the stages of RK4, or its velocity comes from them.
  bool has_stages(int tree) const { return stages && motion.integrated()[tree]; }
  bool goes_as_in_microsteps(int tree) const {
    return on_trees.touched[tree] && (on_trees.held[tree] || !has_stages(tree));
  }
  // Whether the second half of the last step goes to a tree that no row holds any more: MuJoCo's
  // integrator then starts from the velocity with it.
  bool gets_second_half_in_flight(int tree) const {
    return !on_trees.touched[tree] && trapezoid.holds(tree) && trapezoid.added_velocity();
  }
};

}  // namespace dashpot
