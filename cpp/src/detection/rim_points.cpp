#include "dashpot/detection/rim_points.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/mujoco/velocities.hpp"

namespace dashpot::host {

namespace {

// How fast (m/s) any place on a cylinder may come nearer to a plane, whatever spins about its axis.
double closing_of_shape(const mjModel* m, const mjData* d, int plane, int cylinder,
                        const mjtNum* normal, const double* body_velocity) {
  const int body[2] = {m->geom_bodyid[plane], m->geom_bodyid[cylinder]};
  const mjtNum *centre = d->geom_xpos + 3 * cylinder, *rotation = d->geom_xmat + 9 * cylinder;
  const mjtNum axis[3] = {rotation[2], rotation[5], rotation[8]};
  mjtNum velocity[2][3], turn[3], across[3];
  for (int i = 0; i < 2; ++i)
    velocity_of_point(m, d, body[i], body_velocity + 6 * body[i], centre, velocity[i]);
  const double* const spin = body_velocity + 6 * body[1];
  mju_addScl3(turn, spin, axis, -mju_dot3(spin, axis));
  mju_subFrom3(turn, body_velocity + 6 * body[0]);
  mju_cross(across, normal, turn);
  return mju_norm3(across) * m->geom_rbound[cylinder] + mju_dot3(normal, velocity[0]) -
         mju_dot3(normal, velocity[1]);
}

}  // namespace

bool only_spin_brings_near(const mjModel_* m, const mjData_* d, const ReachBuffers& reach,
                           const double* body_velocity, const ContactInput& input) {
  if (input.gap <= 0.0 || input.is_of_flex()) return false;
  const int plane = input.geom[0], cylinder = input.geom[1];
  if (m->geom_type[plane] != mjGEOM_PLANE || m->geom_type[cylinder] != mjGEOM_CYLINDER)
    return false;
  const auto comes = [&](const double* velocity) {
    return m->opt.timestep *
               closing_of_shape(m, d, plane, cylinder, input.frame.data(), velocity) >=
           input.gap;
  };
  return !comes(reach.now.data()) && !comes(reach.later.data()) &&
         !(body_velocity && comes(body_velocity));
}

}  // namespace dashpot::host
