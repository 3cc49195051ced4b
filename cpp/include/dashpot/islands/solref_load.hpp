// The load at which a contact's own solref is read (solref.hpp): one spring and damper are right
// for one load.
//
// A new contact has that of its lighter part's weight. Once it has been still for longer than hits
// last, its load L (m/s^2, A F) follows the force F that it bears,
//
//     L' = (A F - L) / tau ,
//
// so that feet that share a weight, and parts that are gripped with many times theirs, give way as
// far as in MuJoCo, and a hit has the damping ratio of solref. The spring is that of L; the damper
// at most that of the weight, for the damper that solref asks for beside a stiffer spring is one
// that micro-steps seldom resolve. In the first step of all L is that under which the overlap
// rests, as far as the weight.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"

namespace dashpot {

// Reads the solref of contacts that are remembered anew, over a step of `length` (s). `velocity`:
// per motion coordinate, at its start.
void read_solref_at_load(const StepView& step, const double* velocity, Rows& rows,
                         std::vector<GroupMaterial>& materials);

}  // namespace dashpot
