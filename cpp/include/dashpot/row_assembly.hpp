// The rows of a step: what detection found, with materials, Jacobians and inverse masses.

#pragma once

#include <vector>

#include "dashpot/group_material.hpp"
#include "dashpot/mujoco_row_turns.hpp"
#include "dashpot/rows.hpp"
#include "dashpot/team.hpp"
#include "dashpot/tree_motion.hpp"

namespace dashpot {

// Replaces `rows` by those of constraints and contacts, in this order, and `materials` by theirs,
// one per group; fills in the inverse inertia of the trees they reach.
void assemble_rows(const mjModel_* model, const mjData_* data, const Parameters& parameters,
                   const std::vector<ConstraintInput>& constraints,
                   const std::vector<ContactInput>& contacts, const host::RowTurns& turns,
                   TreeMotion& motion, Rows& rows, std::vector<GroupMaterial>& materials,
                   Team& team);

}  // namespace dashpot
