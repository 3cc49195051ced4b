// Velocities of bodies, points and contacts, and where they take axes and weights.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

// Spatial velocity (rotation, translation about the tree's centre of mass; 6 numbers in the world)
// of every body for generalized velocities `qvel`.
void body_velocities(const mjModel_* m, const mjData_* d, const double* qvel,
                     std::vector<double>& velocity);

// Velocity (3, world, m/s) of a body at a point (world) for its `twist`, as in cvel: rotation, and
// translation at the centre of mass of its tree.
void velocity_of_point(const mjModel_* m, const mjData_* d, int body, const double* twist,
                       const double* point, double* velocity);
// The same at the velocities last computed.
void point_velocity(const mjModel_* m, const mjData_* d, int body, const double* point,
                    double* velocity);
// Velocity (m/s) of geom 2 relative to geom 1 in the frame of the contact, as last computed.
std::array<double, 3> contact_velocity(const mjModel_* m, const mjData_* d,
                                       const ContactInput& input);

// Whether the surface of either geom of a contact moves by itself, and what that adds to the rates
// of the contact's rows: to sliding and spin, as in MuJoCo; not to the gap, nor to rolling.
bool has_surface_motion(const mjModel_* m, const ContactInput& input);
std::array<double, 6> surface_motion(const mjModel_* m, const mjData_* d,
                                     const ContactInput& input);
// Whether any of the six numbers of a spatial velocity is not zero.
bool is_moving(const double* spatial);

// Axes of joints, and velocities of bodies, where their velocities take them.
//
// All are twists about the centre of mass of their tree at the start of the step, as cdof and cvel:
// the Jacobian of a point p of a body has the columns axis + angle x (p - centre) of the joints
// above it. What a joint hangs on carries its axis along, so it changes at the rate (twist) x
// (axis). Linear in time: the error is of second order in the turn of a step, as that of the middle
// is. Mocap bodies go on at their velocity, those of their origins and their rates of turn.

// Axis (6) of a degree of freedom, `time` (s) ahead.
void axis_ahead(const mjModel_* m, const mjData_* d, int dof, double time, double* axis);
// How fast (rad/s) what the joints of a tree hang on turns the axis of one of them, at most.
double fastest_carried_axis(const mjData_* d, const Tree& tree);
// Velocity (6) of a body there, its joints going on at the rates of the start.
void twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist);
// What of it a mocap body adds to a body that is fixed to it or hangs on it; zero for all others.
void mocap_twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist);

// What weights change by, as generalized forces, while a tree moves on.
//
// The weight of all that a joint bears turns it by axis . W, with the axis and the wrench W about
// the centre of mass of the tree (axis_ahead, twist_ahead). Both move:
//
//     change = axis(t) . W(t) - axis(0) . W(0) .

enum class Gravity { kLessCompensation, kOfCompensation };

// Adds the change (N or N m, nv) of a tree's weights less their gravity compensation, or of this,
// `time` (s) ahead of the start of the step, all going on at its velocities. `wrench` is room, kept
// from call to call.
void add_gravity_ahead(const mjModel_* m, const mjData_* d, int tree, double time, Gravity gravity,
                       std::vector<double>& wrench, double* change);

// Whether a body of a tree whose inverse inertia is known has a joint with t^2 m g l / 2 I of
// `least` or more, t: `time` (s): by how much gravity that lags by t / 2 turns a part, relative to
// what this has turned in t. m: mass of what hangs on a joint, l: how far its centre is from that.
bool has_light_part(const mjModel_* m, const mjData_* d, const Trees& trees, int tree, double time,
                    double least);

}  // namespace dashpot::host
