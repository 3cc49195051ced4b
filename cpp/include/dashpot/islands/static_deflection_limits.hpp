// In which times loads move contacts by the sag that a rigid one may have.
//
// Islands::plan makes micro-steps so short that rigid contacts are stiff enough for what they bear:
// a weight, what drives a joint against its dry friction, and the load of the last step.

#pragma once

#include <vector>

#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Finds the times of every group; the sag is kRigidSag times the smaller body's radius, less if it
// is thin (host::bearing_radius). Without gravity there is no weight. `velocity`: at the start of
// the step, in motion coordinates; loads of contacts that close or open in it are not known.
void find_deflection_times(const mjModel_* model, const StepView& step, const Rows& rows,
                           const AlignedDoubles& velocity, Team& team,
                           std::vector<DeflectionTime>& of_group);

}  // namespace dashpot
