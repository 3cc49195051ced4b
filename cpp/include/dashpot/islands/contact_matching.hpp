// Which remembered contact each contact of a step goes on from: the nearest of its pair. Of those
// that are nearest to the same one the nearest has it, since a compression that two inherit would
// be two springs as deep, and the others have the nearest that is left. Points that move along
// both geoms, as those of crossing rods, may have passed half of their spacing in a step: what is
// nearest to one of them then is where another was.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Finds the match of every group of `rows`; those of constraints have none.
void match_contacts(const Memory& memory, const std::vector<ContactInput>& contacts,
                    const Rows& rows, std::vector<Match>& matches, Team& team);

}  // namespace dashpot
