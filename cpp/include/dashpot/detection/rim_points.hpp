// Points on the rims of cylinders that spin.
//
// Besides the lowest points of a cylinder MuJoCo gives two that lie a third of a turn away on the
// rim, for cylinders that come down flat. What spins about its axis looks the same: the spin brings
// no place of the rim nearer to a plane. But the points of the body that are in those places move
// down at it, and rows, which follow them along straight lines, would go through the plane where
// the true circle only comes to it.

#pragma once

#include "dashpot/detection/reach.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Whether a contact of a plane and a cylinder is apart, and stays so in the step, the spin of the
// cylinder about its axis left out: at the velocities of the start, at those that smooth motion
// leads to, and at those of `body_velocity` (6 by body, as in cvel), where not null.
bool only_spin_brings_near(const mjModel_* m, const mjData_* d, const ReachBuffers& reach,
                           const double* body_velocity, const ContactInput& input);

}  // namespace dashpot::host
