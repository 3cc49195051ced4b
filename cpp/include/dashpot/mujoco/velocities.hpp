// Velocities of bodies, points and contacts.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

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
// Velocity of geom 2 relative to geom 1 at the contact, in its frame (m/s), at the positions and
// velocities last computed.
std::array<double, 3> contact_velocity(const mjModel_* m, const mjData_* d,
                                       const ContactInput& input);

// Whether the surface of either geom of a contact moves by itself, and what that adds to the rates
// of the contact's rows: to sliding and spin, as in MuJoCo; not to the gap, nor to rolling.
bool has_surface_motion(const mjModel_* m, const ContactInput& input);
std::array<double, 6> surface_motion(const mjModel_* m, const mjData_* d,
                                     const ContactInput& input);
// Whether any of the six numbers of a spatial velocity is not zero.
bool is_moving(const double* spatial);

}  // namespace dashpot::host
