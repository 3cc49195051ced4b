// The load at which a contact's own solref is read (solref.hpp): one spring and damper are right
// for one load.
//
// A new contact has that of its lighter part's weight. Once it has been still for longer than hits
// last, its load L (m/s^2, A F) follows the force F that it bears as far as the weight,
//
//     L' = (A F - L) / tau ,    A F <= that of the weight,
//
// so that feet that share a weight give way as far as in MuJoCo, and a hit has the damping ratio of
// solref. Under more than the weight L is that of the weight: what is pressed harder goes in
// further than in MuJoCo, for a stiffer spring would ask for a damper that micro-steps seldom
// resolve, and fingers would spring open. In the first step of all L is that under which the
// overlap rests.

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
