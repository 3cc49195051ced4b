// What is hit in a step, and which islands are of two trees that hit each other alone.

#pragma once

#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Fills in what is hit, and lone pairs, in `data`: of islands of few groups contacts and limits
// that touch in a step of `step` (s) and are hit, or fly off. Two trees, or one and the ground, are
// alone where nothing else disturbs their hit (hit.hpp), whatever else was found ahead. What
// hangs at its deepest at the start of a step has no rate to tell it by: hits of lone pairs go on
// for one step after, `matches` being what `memory` has of contacts.
void find_hits(const Memory& memory, const std::vector<Match>& matches, const Rows& rows,
               const std::vector<Island>& islands, const std::vector<ContactInput>& contacts,
               const std::vector<ConstraintInput>& constraints, const HitFrequency& frequency,
               double step, RowData& data);

}  // namespace dashpot
