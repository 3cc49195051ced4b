// Which bodies users alone move, and what they hold: mocap bodies, and bodies that are fixed to the
// world, which edits of the model move.

#pragma once

#include <array>
#include <vector>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Their numbers: mocap bodies in their order, then those whose parent is the world and that have no
// joint.
std::vector<int> driven_bodies(const mjModel_* m);
// Whether a body is fixed to the world, or to one of these.
bool is_fixed(const mjModel_* m, int body);
// Rotation and translation (6, as in cvel and about the same point) by which one of these takes a
// body along that is fixed to it or hangs on it by joints; null for all others.
const double* mocap_twist(const mjModel_* m, const mjData_* d, int body);
// Whether a connect or weld holds something to a mocap body. What it pulls at may not be able to
// follow, and a rigid row would tear at it: such rows are as soft as their solref says, MuJoCo's
// default too.
bool is_held_by_mocap(const mjModel_* m, int equality);
// Whether an equality is a connect or weld of a mocap body, by its index among them, or of what is
// fixed to it; and whether any active one is.
bool holds(const mjModel_* m, int equality, int mocap);
bool holds_anything(const mjModel_* m, const mjData_* d, int mocap);
// Position (m) and quaternion that a mocap body with the pose `pose`, which the kinematics in `d`
// are of, would need for the first of its active connects and welds to be met; `pose` without any.
std::array<double, 7> pose_where_met(const mjModel_* m, const mjData_* d, int mocap,
                                     const std::array<double, 7>& pose);

}  // namespace dashpot::host
