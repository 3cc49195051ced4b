// A step, or part of one: where the present substep is in it, what its rows were made from, memory.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// What is left of a step, or how far an impact is ahead, counts as nothing below this share of it.
constexpr double kSliverOfStep = 1e-9;

struct StepClock {
  double whole = 0.0;          // s, of the step
  double length = 0.0;         // H, s, of the substep, which is the whole step if nothing cuts it
  double row_turn_rate = 0.0;  // rad/s, of equalities in the substep before; 0 in the first
  bool cut_short = false;      // the substep ends at an impact
  int cuts = 0;                // at impacts, in the substeps before
};

struct StepView {
  double length;  // s
  const std::vector<ContactInput>& contacts;
  const std::vector<ConstraintInput>& constraints;
  Memory memory;                      // a view of what the last step left
  const std::vector<Match>& matches;  // per group: what it has of contacts
};

}  // namespace dashpot
