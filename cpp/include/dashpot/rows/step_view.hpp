// One step, or part of one, as its rows see it: what they were made from, and what is remembered of
// that.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

struct StepView {
  double length;  // s
  const std::vector<ContactInput>& contacts;
  const std::vector<ConstraintInput>& constraints;
  Memory memory;                      // a view of what the last step left
  const std::vector<Match>& matches;  // per group: what it has of contacts
};

}  // namespace dashpot
