// The load at which a contact's own solref is read (solref.hpp): one spring and damper are right
// for one load.
//
// A new contact has that of its lighter part's weight. Once it has been still for longer than hits
// last, its load L (m/s^2, A F) follows the force F that it bears,
//
//     L' = (A F - L) / tau ,
//
// so that under what it bears at rest it gives way as far as in MuJoCo, and a hit has the damping
// ratio of solref. In the first step of all L is that under which the overlap rests, up to two
// weights: what rests in MuJoCo rests here.

#pragma once

#include <vector>

#include "dashpot/group_material.hpp"
#include "dashpot/memory.hpp"
#include "dashpot/rows.hpp"

namespace dashpot {

// Reads the solref of contacts that are remembered anew, over a step of `length` (s). `velocity`:
// per motion coordinate, at its start.
void read_solref_at_load(const Memory& memory, const std::vector<Match>& matches,
                         const std::vector<ContactInput>& contacts, const double* velocity,
                         double length, Rows& rows, std::vector<GroupMaterial>& materials);

}  // namespace dashpot
