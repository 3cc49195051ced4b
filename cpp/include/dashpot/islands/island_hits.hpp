// What is hit in a step, and which islands are of two trees that hit each other alone.

#pragma once

#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"

namespace dashpot {

// Fills in what is hit, and isolated pairs, in `data`: of islands of few groups contacts and limits
// that touch in the step and are hit, or fly off. Two trees, or one and the ground, are alone where
// nothing else disturbs their hit (hit.hpp), whatever else was found ahead. What hangs at its
// deepest at the start of a step has no rate to tell it by: hits of isolated pairs go on for one
// step after.
void find_hits(const StepView& step, const Rows& rows, const std::vector<Island>& islands,
               const HitFrequency& frequency, RowData& data);

}  // namespace dashpot
