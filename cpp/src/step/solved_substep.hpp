// A substep whose rows are solved, as all that follows from that sees it.

#pragma once

#include <vector>

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// By tree, what rows did to it in the substep, see RowsOnTree.
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

struct SolvedSubstep {
  mjModel_* model;
  double length;  // H, s
  const std::vector<ContactInput>& contacts;
  const std::vector<ConstraintInput>& constraints;
  const Rows& rows;
  const RowData& data;
  const RowsOnTrees& on_trees;
  const std::vector<double>&
      recovery;  // by motion coordinate: displacement that equalities recover
  const TreeMotion& motion;
  const Trapezoid& trapezoid;
};

}  // namespace dashpot
