// What is hit in a step, which islands are of two trees that hit each other alone, what stays open.

#pragma once

#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Fills in what is hit, and isolated pairs, in `data`: of islands of few groups contacts and limits
// that touch in the step and are hit, or fly off. Two trees, or one and the ground, are alone where
// nothing else disturbs their hit (hit.hpp), whatever else was found ahead. At its deepest a hit
// has no rate to tell it by: those of isolated pairs go on for one step after.
void find_hits(const StepView& step, const Rows& rows, const std::vector<Island>& islands,
               const HitFrequency& frequency, RowData& data);

// Contacts and limits that are found ahead, but stay open.
//
// Detection looks as far as bodies may come in a step, whatever hits them meanwhile. What is found
// there acts on nothing; but in the bound on the coupling of their rows (row_stiffness.hpp) it
// would make all rigid rows of its trees softer, and change them from step to step. So bounds leave
// out a group of gap g in a step H with
//
//     g >= kMayMeet H (v_1 + v_2) ,
//
// v_T being the fastest that any gap of tree T closes: what one impulse does to the others. If more
// than that happens to it, its rows are too stiff in that step for a resolution of theta = 1, where
// micro-steps are stable up to 2. What hits and turns may be thrown at anything: trees with gaps
// that close or open as fast as hits do (hit_speed) leave out nothing. Nor do islands of few groups
// that are hit: the blow runs through them, as through a row of balls, on springs of one stiffness.
//
// By group, from the velocities and smooth accelerations in `data`: whether it stays open.
void find_inactive_contacts(const StepView& step, const Rows& rows,
                            const std::vector<Island>& islands, int tree_count, const RowData& data,
                            std::vector<char>& stays_open);

}  // namespace dashpot
