#include "dashpot/mujoco/moved_axes.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/mujoco/mocap_bodies.hpp"
#include "dashpot/mujoco/properties.hpp"

namespace dashpot::host {

namespace {

// moved += time * (twist x moved)
void add_carried(const mjtNum* twist, double time, mjtNum* moved) {
  mjtNum angular[3], linear[3], shift[3];
  mju_cross(angular, twist, moved);
  mju_cross(linear, twist, moved + 3);
  mju_cross(shift, twist + 3, moved);
  mju_addTo3(linear, shift);
  mju_addToScl3(moved, angular, time);
  mju_addToScl3(moved + 3, linear, time);
}

// Adds what a joint of several axes turns its own axes by, which cdof_dot leaves out: in the sum
// over all of them it cancels.
void add_own_turn(const mjModel* m, const mjData* d, int dof, double time, mjtNum* axis) {
  const int joint = m->dof_jntid[dof];
  const int type = m->jnt_type[joint];
  if (type != mjJNT_FREE && type != mjJNT_BALL) return;
  const int first = m->jnt_dofadr[joint] + (type == mjJNT_FREE ? 3 : 0);
  if (dof < first) return;
  mjtNum own[6] = {};
  for (int i = first; i < first + 3; ++i) mju_addToScl(own, d->cdof + 6 * i, d->qvel[i], 6);
  add_carried(own, time, axis);
}

}  // namespace

void axis_ahead(const mjModel_* m, const mjData_* d, int dof, double time, double* axis) {
  std::copy_n(d->cdof + 6 * dof, 6, axis);
  if (time == 0.0) return;
  add_own_turn(m, d, dof, time, axis);
  const mjtNum* rate = d->cdof_dot + 6 * dof;
  for (int i = 0; i < 6; ++i) axis[i] += time * rate[i];
  if (const mjtNum* carrier = mocap_twist(m, d, m->dof_bodyid[dof]))
    add_carried(carrier, time, axis);
}

double fastest_carried_axis(const mjData_* d, const Tree& tree) {
  double fastest = 0.0;
  for (int dof = tree.dof_begin; dof < tree.dof_begin + tree.dof_count; ++dof)
    fastest = std::max(fastest, mju_norm3(d->cdof_dot + 6 * dof));
  return fastest;
}

void twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist) {
  mju_zero(twist, 6);
  for (int dof = last_dof(m, body); dof >= 0; dof = m->dof_parentid[dof]) {
    mjtNum axis[6];
    axis_ahead(m, d, dof, time, axis);
    for (int i = 0; i < 6; ++i) twist[i] += d->qvel[dof] * axis[i];
  }
  if (!mocap_twist(m, d, body)) return;
  mjtNum carrier[6];
  mocap_twist_ahead(m, d, body, time, carrier);
  mju_addTo(twist, carrier, 6);
}

void mocap_twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist) {
  const mjtNum* carrier = mocap_twist(m, d, body);
  if (!carrier) return mju_zero(twist, 6);
  mju_copy(twist, carrier, 6);
  const int root = m->body_rootid[body];
  mjtNum arm[3], origin[3], change[3];
  mju_sub3(arm, d->xpos + 3 * root, d->subtree_com + 3 * root);
  mju_cross(origin, carrier, arm);
  mju_addTo3(origin, carrier + 3);
  mju_cross(change, carrier, origin);
  mju_addToScl3(twist + 3, change, -time);
}

}  // namespace dashpot::host
