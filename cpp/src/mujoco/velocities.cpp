#include "dashpot/mujoco/velocities.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>

#include "dashpot/mujoco/mocap_bodies.hpp"

namespace dashpot::host {

void body_velocities(const mjModel_* m, const mjData_* d, const double* qvel,
                     std::vector<double>& velocity) {
  velocity.assign(6 * m->nbody, 0.0);
  for (int body = 1; body < m->nbody; ++body) {
    std::array<double, 6> sum;
    std::copy_n(
        is_fixed(m, body) ? d->cvel + 6 * body : velocity.data() + 6 * m->body_parentid[body], 6,
        sum.begin());
    const int end = m->body_dofadr[body] + m->body_dofnum[body];
    for (int j = m->body_dofadr[body]; j < end; ++j)
      for (int i = 0; i < 6; ++i) sum[i] += d->cdof[6 * j + i] * qvel[j];
    std::copy(sum.begin(), sum.end(), velocity.begin() + 6 * body);
  }
}

void velocity_of_point(const mjModel_* m, const mjData_* d, int body, const double* twist,
                       const double* point, double* velocity) {
  double arm[3];
  mju_sub3(arm, point, d->subtree_com + 3 * m->body_rootid[body]);
  mju_cross(velocity, twist, arm);
  mju_addTo3(velocity, twist + 3);
}

void point_velocity(const mjModel_* m, const mjData_* d, int body, const double* point,
                    double* velocity) {
  velocity_of_point(m, d, body, d->cvel + 6 * body, point, velocity);
  // What a fixed body has of its own is in cvel, that of what hangs on it relative to it.
  const mjtNum* carrier = is_fixed(m, body) ? nullptr : mocap_twist(m, d, body);
  if (!carrier) return;
  mjtNum carried[3];
  velocity_of_point(m, d, body, carrier, point, carried);
  mju_addTo3(velocity, carried);
}

bool is_moving(const double* spatial) {
  return std::any_of(spatial, spatial + 6, [](mjtNum value) { return value != 0.0; });
}

bool has_surface_motion(const mjModel_* m, const ContactInput& input) {
  return std::any_of(input.geom.begin(), input.geom.end(), [&](int geom) {
    return geom >= 0 && is_moving(m->geom_surfacevel + 6 * geom);
  });
}

std::array<double, 6> surface_motion(const mjModel_* m, const mjData_* d,
                                     const ContactInput& input) {
  mjtNum linear[3] = {}, angular[3] = {};
  for (int side = 0; side < 2; ++side) {
    const int geom = input.geom[side];
    if (geom < 0) continue;
    const mjtNum* own = m->geom_surfacevel + 6 * geom;
    const mjtNum* rotation = d->geom_xmat + 9 * geom;
    mjtNum v[3], w[3], arm[3], around[3];
    mju_mulMatVec3(v, rotation, own);
    mju_mulMatVec3(w, rotation, own + 3);
    mju_sub3(arm, input.position.data(), d->geom_xpos + 3 * geom);
    mju_cross(around, w, arm);
    mju_addTo3(v, around);
    mju_addToScl3(linear, v, side ? 1.0 : -1.0);
    mju_addToScl3(angular, w, side ? 1.0 : -1.0);
  }
  const double* frame = input.frame.data();
  return {
      0.0, mju_dot3(frame + 3, linear), mju_dot3(frame + 6, linear), mju_dot3(frame, angular), 0.0,
      0.0};
}

std::array<double, 3> contact_velocity(const mjModel_* m, const mjData_* d,
                                       const ContactInput& input) {
  if (input.is_of_flex()) {
    const mjtNum* rate = d->efc_vel + d->contact[input.source].efc_address;
    return {rate[0], input.dim > 1 ? rate[1] : 0.0, input.dim > 1 ? rate[2] : 0.0};
  }
  mjtNum relative[3] = {0, 0, 0};
  for (int side = 0; side < 2; ++side) {
    mjtNum velocity[3];
    point_velocity(m, d, m->geom_bodyid[input.geom[side]], input.position.data(), velocity);
    mju_addToScl3(relative, velocity, side ? 1.0 : -1.0);
  }
  std::array<double, 3> result;
  mju_mulMatVec3(result.data(), input.frame.data(), relative);
  if (!has_surface_motion(m, input)) return result;
  const std::array<double, 6> surface_rate = surface_motion(m, d, input);
  for (int i = 1; i < 3; ++i) result[i] += surface_rate[i];
  return result;
}

}  // namespace dashpot::host
