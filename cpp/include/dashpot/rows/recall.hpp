// What rows take from memory at the start of a step.
//
// A contact takes the smaller of the overlap that collision reports and the compression remembered
// at the point of the same geom pair that it goes on from (islands/contact_matching.hpp); what
// geometry reports beyond that is an unstressed penetration. Where two bodies hit each other alone,
// in less than a step, it keeps all of its compression, also across a gap that is smaller than
// that: frozen rows lead too deep there. Limits and equalities do the same with their position. In
// the first step of all a contact of SI stiffness takes what its spring bears, and so does a
// contact or limit whose solref the model sets; an equality with one does whenever nothing is
// remembered of it, as where it is switched on. One that the steps resolve has its position for its
// deformation in every step.
//
// Limits and equalities whose load goes by their position (islands/solref_load.hpp) are deformed by
// what bears it, as far as they store no more than they took.
//
// Where the stiffness of a row has changed since (rigid rows follow the micro-step), the remembered
// deformation is scaled so that its force is continuous, the energy that a rising stiffness takes
// being kept for a falling one; what that puts beyond the position is preload. Rigid rows keep it
// until they separate: otherwise every change of stiffness would drop force, and the jolt change
// the stiffness again. Of what is hit it is the energy that goes on, not the force, in a cluster
// where an elastic contact stiffens: the energy that a force which went on would lose is what it is
// about to give back, a third of a ball's that hits two in a row. Contacts of SI stiffness, which
// users change, and of a model's own solref, whose load changes, recover it like offsets.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Fills deformation and unstressed penetration, none of the latter with infinite `recovery_speed`.
void recall(const StepView& step, const Rows& rows, double recovery_speed, RowData& data,
            Team& team);

// After recall: where the contacts of one of `pairs` (geom ids, sorted) store more along their
// normals than the pair remembers, as points that are new among old ones do, all of them give way.
void limit_compression(const StepView& step, const std::vector<std::array<int, 2>>& pairs,
                       const Rows& rows, RowData& data);

}  // namespace dashpot
