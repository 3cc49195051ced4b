// Axes of joints, and velocities of bodies, where their velocities take them.
//
// All are twists about the centre of mass of their tree at the start of the step, as cdof and cvel:
// the Jacobian of a point p of a body has the columns axis + angle x (p - centre) of the joints
// above it. What a joint hangs on carries its axis along, so it changes at the rate (twist) x
// (axis). Linear in time: the error is of second order in the turn of a step, as that of the middle
// is. Mocap bodies go on at their velocity, those of their origins and their rates of turn.

#pragma once

#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Axis (6) of a degree of freedom, `time` (s) ahead.
void axis_ahead(const mjModel_* m, const mjData_* d, int dof, double time, double* axis);
// How fast (rad/s) what the joints of a tree hang on turns the axis of one of them, at most.
double fastest_carried_axis(const mjData_* d, const Tree& tree);
// Velocity (6) of a body there, its joints going on at the rates of the start.
void twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist);
// What of it a mocap body adds to a body that is fixed to it or hangs on it; zero for all others.
void mocap_twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist);

}  // namespace dashpot::host
