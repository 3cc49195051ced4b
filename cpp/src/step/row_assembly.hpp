// The rows of a step: what detection found, with materials, Jacobians and inverse masses.

#pragma once

#include <vector>

#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/islands/group_material.hpp"
#include "dashpot/model/row_turns.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Replaces `rows` by those of constraints and contacts, in this order, and `materials` by theirs,
// one per group; fills in the inverse inertia of the trees they reach.
void assemble_rows(const mjModel_* model, const mjData_* data, const Parameters& parameters,
                   const std::vector<ConstraintInput>& constraints,
                   const std::vector<ContactInput>& contacts, const host::RowTurns& turns,
                   TreeMotion& motion, Rows& rows, std::vector<GroupMaterial>& materials,
                   Team& team);

}  // namespace dashpot
