// Contacts of capsules and cylinders that lie side by side. Part of the mujoco_host room.
//
// MuJoCo gives the nearest points of two of them, one contact unless the axes of capsules are
// parallel to rounding. Of axes that cross at a small angle theta, d apart, the gap along them is
//
//     g(x) = g_0 + m (x - x_0) + theta^2 (x - x_0)^2 / (2 d) ,   m = 0 between their ends,
//
// and a tilt by alpha takes the nearest point x_0 by alpha d / theta^2 along them: from end to end
// in a step. What is pressed there rocks for good, on what recovery puts in. But a contact is as
// long as what it may sag by: to where the last term is a tolerance. Two points at the ends of
// that, with the gap g_0 + m (x - x_0), stand for it.

#pragma once

struct mjModel_;
struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Whether a type of geom has a straight side that is round: capsules and cylinders.
bool has_round_side(int type);

// Puts the ends of where two such geoms touch, side by side, in place of their nearest points
// `contact[0]`; returns how many they are, at most two: those within `margin` (m).
int take_ends_of_sides(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                       mjPreContact_* contact);

}  // namespace dashpot::host
