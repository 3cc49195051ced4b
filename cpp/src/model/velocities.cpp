#include "dashpot/model/velocities.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/properties.hpp"

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

// Adds what a joint of several axes turns its axes by, which cdof_dot leaves out: the sum cancels.
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
