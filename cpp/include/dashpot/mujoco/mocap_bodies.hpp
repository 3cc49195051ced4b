// Which bodies are mocap bodies, and what they hold.

#pragma once

#include <array>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Whether a body is a mocap body or fixed to one.
bool is_mocap(const mjModel_* m, int body);
// Rotation and translation (6, as in cvel and about the same point) by which a mocap body takes a
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
