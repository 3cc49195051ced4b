#include "dashpot/mujoco_moved_axes.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

namespace dashpot::host {

namespace {

// Adds what a joint of several axes turns its own axes by, which cdof_dot leaves out: in the sum
// over all of them it cancels.
void add_own_turn(const mjModel* m, const mjData* d, int dof, mjtNum* rate) {
  const int joint = m->dof_jntid[dof];
  int first = m->jnt_dofadr[joint];
  if (m->jnt_type[joint] == mjJNT_FREE) first += 3;
  const bool turns = m->jnt_type[joint] == mjJNT_FREE || m->jnt_type[joint] == mjJNT_BALL;
  if (!turns || dof < first) return;
  mjtNum own[6] = {};
  for (int i = first; i < first + 3; ++i) mju_addToScl(own, d->cdof + 6 * i, d->qvel[i], 6);
  const mjtNum* axis = d->cdof + 6 * dof;
  mjtNum change[3];
  mju_cross(change, own, axis);
  mju_addTo3(rate, change);
  mju_cross(change, own, axis + 3);
  mju_addTo3(rate + 3, change);
  mju_cross(change, own + 3, axis);
  mju_addTo3(rate + 3, change);
}

}  // namespace

void axis_ahead(const mjModel_* m, const mjData_* d, int dof, double time, double* axis) {
  mjtNum rate[6];
  mju_copy(rate, d->cdof_dot + 6 * dof, 6);
  add_own_turn(m, d, dof, rate);
  mju_addScl(axis, d->cdof + 6 * dof, rate, time, 6);
}

void twist_ahead(const mjModel_* m, const mjData_* d, int body, double time, double* twist) {
  std::copy_n(d->cvel + 6 * body, 6, twist);
  while (body > 0 && m->body_dofnum[body] == 0) body = m->body_parentid[body];
  if (body == 0) return;
  for (int dof = m->body_dofadr[body] + m->body_dofnum[body] - 1; dof >= 0;
       dof = m->dof_parentid[dof])
    mju_addToScl(twist, d->cdof_dot + 6 * dof, time * d->qvel[dof], 6);
}

}  // namespace dashpot::host
