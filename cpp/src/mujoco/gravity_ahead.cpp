#include "dashpot/mujoco/gravity_ahead.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/mujoco/moved_axes.hpp"

namespace dashpot::host {

namespace {

// Of each body: the wrench of its weight about the centre of mass of the tree, and what that
// changes by; with those of all bodies that hang on it.
constexpr int kWrench = 6, kSize = 9;

void add_own_weight(const mjModel* m, const mjData* d, int body, double time, Gravity gravity,
                    double* wrench) {
  mjtNum weight[3], arm[3], torque[3], velocity[3], shift[3];
  const mjtNum compensated = m->body_gravcomp[body];
  const mjtNum part = gravity == Gravity::kOfCompensation ? -compensated : 1.0 - compensated;
  mju_scl3(weight, m->opt.gravity, m->body_mass[body] * part);
  mju_sub3(arm, d->xipos + 3 * body, d->subtree_com + 3 * m->body_rootid[body]);
  mju_cross(torque, arm, weight);
  mju_addTo3(wrench, torque);
  mju_addTo3(wrench + 3, weight);
  const mjtNum* twist = d->cvel + 6 * body;
  mju_cross(velocity, twist, arm);
  mju_addTo3(velocity, twist + 3);
  mju_cross(shift, velocity, weight);
  mju_addToScl3(wrench + kWrench, shift, time);
}

}  // namespace

bool has_light_part(const mjModel_* m, const mjData_* d, const Trees& trees, int tree, double time,
                    double least) {
  if (m->opt.disableflags & mjDSBL_GRAVITY) return false;
  const Tree& t = trees.tree[tree];
  const double way = 0.5 * time * time * mju_norm3(m->opt.gravity);
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i, joint = m->dof_jntid[dof], body = m->dof_bodyid[dof];
    if (mju_norm3(d->cdof + 6 * dof) == 0.0) continue;  // slides
    const double arm = mju_dist3(d->subtree_com + 3 * body, d->xanchor + 3 * joint);
    const double inverse = inverse_diagonal(trees, tree, i);
    if (way * m->body_subtreemass[body] * arm * inverse >= least) return true;
  }
  return false;
}

void add_gravity_ahead(const mjModel_* m, const mjData_* d, int tree, double time, Gravity gravity,
                       std::vector<double>& wrench, double* change) {
  if (m->opt.disableflags & mjDSBL_GRAVITY) return;
  const int first = m->tree_bodyadr[tree], end = first + m->tree_bodynum[tree];
  wrench.assign(kSize * (end - first), 0.0);
  for (int body = end - 1; body >= first; --body) {
    double* of = wrench.data() + kSize * (body - first);
    add_own_weight(m, d, body, time, gravity, of);
    const int parent = m->body_parentid[body];
    if (parent < first) continue;
    double* on = wrench.data() + kSize * (parent - first);
    for (int i = 0; i < kSize; ++i) on[i] += of[i];
  }
  for (int dof = m->tree_dofadr[tree]; dof < m->tree_dofadr[tree] + m->tree_dofnum[tree]; ++dof) {
    const double* of = wrench.data() + kSize * (m->dof_bodyid[dof] - first);
    const mjtNum* start = d->cdof + 6 * dof;
    mjtNum axis[6];
    axis_ahead(m, d, dof, time, axis);
    for (int i = 0; i < 6; ++i) change[dof] += (axis[i] - start[i]) * of[i];
    change[dof] += mju_dot3(axis, of + kWrench);
  }
}

}  // namespace dashpot::host
