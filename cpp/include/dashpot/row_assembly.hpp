// The rows of a step: what detection found, with materials, Jacobians and inverse masses.

#pragma once

#include <vector>

#include "dashpot/group_material.hpp"
#include "dashpot/rows.hpp"
#include "dashpot/tree_motion.hpp"

namespace dashpot {

// Replaces `rows` by those of constraints and contacts, in this order, and `materials` by theirs,
// one per group; fills in the inverse inertia of the trees they reach.
void assemble_rows(const mjModel_* model, const mjData_* data, const Parameters& parameters,
                   const std::vector<ConstraintInput>& constraints,
                   const std::vector<ContactInput>& contacts, TreeMotion& motion, Rows& rows,
                   std::vector<GroupMaterial>& materials);

// For Islands::plan: in which time (s) a weight moves the smaller body of a contact by the sag that
// a rigid contact may have; infinite for all other groups, and without gravity.
void find_sag_times(const mjModel_* model, const Rows& rows,
                    const std::vector<ContactInput>& contacts, std::vector<double>& sag_time);

}  // namespace dashpot
