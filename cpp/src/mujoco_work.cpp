// Work of the smooth forces over a step. Part of the mujoco_host room.
//
// A step solves (M + H D) dv = f dt + J'dp with f the smooth forces at its start, D what the
// effective inertia has of dampers and actuators (mujoco_host.hpp) and p the impulses of the rows,
// which may come at any time in it. So
//
//     v(t) = v0 + a t + u(t),    a = inv(M + H D) f,    u = inv(M + H D) J'p,
//     change of v'M v / 2 = f'x + (work of the rows) - H (v1' D v1 - v0' D v0) / 2
//
// with x the displacement, the integral of v. Without rows x = H (v0 + v1) / 2, and of f = -D v0
// these terms take H v1' D (v0 + v1) / 2, what a damper of force D v1 dissipates.
//
// Rows that change the velocity within a moment do the work of H D du beside that of M du, as if
// H D were inertia; the terms above give that energy back. No damper does: it brakes at the
// velocities that there are. So of a tree that rows moved, with g the damping force at v0,
//
//     dissipated = x' (D (w - v0) - g),    w = x / H + s (v1 - v0) / 2,
//
// w being the mean velocity and the implicit half step beyond it. Where rows act evenly over the
// step, as dry friction does, s is 1 and nothing differs, since x = H (v0 + v1) / 2. An impact
// leaves a mean velocity nearer to that before it or to that after it, by up to half of v1 - v0.
// Twice that much s takes from v1 - v0, but nothing of what smooth forces change. With sizes in the
// norm of D,
//
//     s = max(1 - 2 |x / H - (v0 + v1) / 2| / |v1 - v0|, H |a| / |v1 - v0|),    at most 1.
//
// What the rows dissipated changes by the difference; so it does by that of the work of actuators,
// by the part of D that is theirs. An error of order H remains in steps with impacts, whose time
// within the step is not known here; of a damper that would stop the motion within a step it can be
// more than there is energy. But passive dampers dissipate no less than nothing, and no more than
// what they and the rows took from the motion together.
//
// With RK4, D is half of the joint damping, so that dampers brake at the mean velocity: w - v0 is
// 2 (x / H - v0). Instead of f stands the mean of the smooth forces at both ends of the step, that
// of dampers without what D accounts for.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "dashpot/mujoco_host.hpp"

extern "C" void mjd_passive_vel(const mjModel* m, mjData* d);

namespace dashpot::host {

namespace {

// Derivative of the damping force (c + c_1 |v| + c_2 v^2) v.
double damping_derivative(double damping, const mjtNum* high_order, double velocity) {
  double slope = damping, power = 1.0;
  for (int i = 0; i < mjNPOLY; ++i) {
    power *= std::abs(velocity);
    slope += (i + 2) * high_order[i] * power;
  }
  return slope;
}

// u' D v over the degrees of freedom of a tree with D = -qDeriv, whose lower triangle M's sparsity
// maps.
double derivative_form(const mjModel* m, const mjData* d, const Tree& t, const double* u,
                       const double* v) {
  double sum = 0.0;
  for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
    for (int k = m->M_rowadr[i]; k < m->M_rowadr[i] + m->M_rownnz[i]; ++k) {
      const int j = m->M_colind[k];
      const double product = i == j ? u[i] * v[i] : u[i] * v[j] + u[j] * v[i];
      sum -= d->qDeriv[m->mapD2M[k]] * product;
    }
  return sum;
}

// The same with the D of dampers, whatever it comes from; that of joints at the start of the step.
double damping_form(const mjModel* m, const mjData* d, const Tree& t, const double* start_velocity,
                    const double* u, const double* v) {
  if (takes_derivatives(m)) return derivative_form(m, d, t, u, v);
  const double weight = joint_damping_weight(m);
  if (weight == 0.0) return 0.0;
  double sum = 0.0;
  for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
    sum += joint_damping(m, i, start_velocity[i]) * u[i] * v[i];
  return weight * sum;
}

// Whether the integrator treats any force on a tree implicitly.
bool brakes(const Tree& t) { return !t.free_body; }

// Whether dampers and fluids can only brake: wind, and coefficients below zero, drive.
bool is_passive(const mjModel* m) {
  const auto none_below_zero = [](const mjtNum* values, mjtSize count) {
    return std::none_of(values, values + count, [](mjtNum value) { return value < 0.0; });
  };
  return mju_norm3(m->opt.wind) == 0.0 && none_below_zero(m->dof_damping, m->nv) &&
         none_below_zero(m->dof_dampingpoly, mjNPOLY * m->nv) &&
         none_below_zero(m->tendon_damping, m->ntendon) &&
         none_below_zero(m->tendon_dampingpoly, mjNPOLY * m->ntendon) &&
         none_below_zero(m->actuator_damping, m->nactuator) &&
         none_below_zero(m->actuator_dampingpoly, mjNPOLY * m->nactuator);
}

// Joins the groups of all trees that a damped tendon reaches: on one of them it may do work. Others
// are their own.
void group_trees(const mjModel* m, int trees, std::vector<int>& group) {
  group.resize(trees);
  std::iota(group.begin(), group.end(), 0);
  for (int tendon = 0; tendon < m->ntendon; ++tendon) {
    const mjtNum* high_order = m->tendon_dampingpoly + mjNPOLY * tendon;
    if (damping_derivative(m->tendon_damping[tendon], high_order, 1.0) == 0.0) continue;
    const int begin = m->ten_J_rowadr[tendon];
    for (int k = begin + 1; k < begin + m->ten_J_rownnz[tendon]; ++k) {
      const int one = group[m->dof_treeid[m->ten_J_colind[begin]]];
      const int other = group[m->dof_treeid[m->ten_J_colind[k]]];
      if (one != other) std::replace(group.begin(), group.end(), other, one);
    }
  }
}

// Generalized force of the weight of the subtree that a degree of freedom moves.
double weight_of_subtree(const mjModel* m, const mjData* d, int dof) {
  const int body = m->dof_bodyid[dof];
  mjtNum weight[3], arm[3], torque[3];
  mju_scl3(weight, m->opt.gravity, m->body_subtreemass[body]);
  // Axes are about the tree's centre of mass.
  mju_sub3(arm, d->subtree_com + 3 * body, d->subtree_com + 3 * m->body_rootid[body]);
  mju_cross(torque, arm, weight);
  const mjtNum* axis = d->cdof + 6 * dof;
  return mju_dot3(axis, torque) + mju_dot3(axis + 3, weight);
}

}  // namespace

double joint_damping(const mjModel_* m, int dof, double velocity) {
  double damping =
      damping_derivative(m->dof_damping[dof], m->dof_dampingpoly + mjNPOLY * dof, velocity);
  const int actuator = m->jnt_actuatorid[m->dof_jntid[dof]];
  if (actuator < 0) return damping;
  const double gear = m->actuator_gear[6 * m->actuator_outadr[actuator]];
  return damping + gear * gear *
                       damping_derivative(m->actuator_damping[actuator],
                                          m->actuator_dampingpoly + mjNPOLY * actuator, velocity);
}

void SmoothWork::find(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion) {
  damping = applied = 0.0;
  find_mean_forces(m, d, motion);
  for (int i = 0; i < m->nv; ++i) applied += driving_force_[i] * motion.displacement[i];
  const int count = static_cast<int>(trees.tree.size());
  group_trees(m, count, group);
  left_to_rows.assign(count, 0.0);
  find_braking(m, d, trees, motion);
  bool differ = false;
  for (int index = 0; index < count; ++index)
    differ |= touched_[index] && (dampers_[index].differs() || actuators_[index].differs() ||
                                  dampers_[index].integrated < 0.0);
  if (differ) find_losses(m, d, trees, motion);
  const bool passive = differ && is_passive(m);
  for (int index = 0; index < count; ++index) {
    double dissipated = dampers_[index].integrated, taken = actuators_[index].integrated;
    if (differ && touched_[index]) {
      if (passive) {
        const double most = std::max({0.0, dissipated, lost_[index]});
        dissipated = std::clamp(dampers_[index].at_mean, 0.0, most);
      }
      // Rows do not come to have put in what they took.
      taken = std::min(actuators_[index].at_mean, taken + std::max(0.0, lost_[index] - dissipated));
      left_to_rows[index] =
          dampers_[index].integrated - dissipated + actuators_[index].integrated - taken;
    }
    damping -= dissipated;
    applied -= taken;
  }
}

void SmoothWork::find_mean_forces(const mjModel_* m, const mjData_* d, const StepMotion& motion) {
  for (auto* array : {&undamped_force_, &driving_force_, &damping_force_}) array->resize(m->nv);
  for (int i = 0; i < m->nv; ++i) {
    damping_force_[i] = damping_force(d, i);
    driving_force_[i] = driving_force(d, i);
    undamped_force_[i] = d->qfrc_smooth[i] - damping_force_[i];
    if (!motion.end || !(*motion.integrated)[m->dof_treeid[i]]) continue;
    const SmoothForces& end = *motion.end;
    const double drag = joint_damping(m, i, motion.start_velocity[i]);
    const double accounted =
        joint_damping_weight(m) * 2.0 * drag * (end.velocity[i] - motion.start_velocity[i]);
    damping_force_[i] += 0.5 * (end.damping[i] + accounted - damping_force_[i]);
    driving_force_[i] += 0.5 * (end.driving[i] - driving_force_[i]);
    undamped_force_[i] += 0.5 * (end.all[i] - end.damping[i] - undamped_force_[i]);
  }
}

void SmoothWork::find_braking(const mjModel_* m, mjData_* d, const Trees& trees,
                              const StepMotion& motion) {
  const int count = static_cast<int>(trees.tree.size());
  dampers_.assign(count, {});
  actuators_.assign(count, {});
  touched_.assign(count, 0);
  kept_.assign(count, 1.0);
  for (auto* array : {&change_, &mean_change_, &unevenness_}) array->resize(m->nv);
  for (int i = 0; i < m->nv; ++i) {
    change_[i] = d->qvel[i] - motion.start_velocity[i];
    mean_change_[i] = motion.displacement[i] / m->opt.timestep - motion.start_velocity[i];
    unevenness_[i] = mean_change_[i] - 0.5 * change_[i];
    const int tree = m->dof_treeid[i];
    const double explicit_part = -damping_force_[i] * motion.displacement[i];
    dampers_[group[tree]] += {explicit_part, explicit_part};
    if ((*motion.touched)[tree]) touched_[group[tree]] = 1;
  }
  const auto derive_at_start = [&](const auto& derive) {
    end_velocity_.assign(d->qvel, d->qvel + m->nv);
    std::copy_n(motion.start_velocity, m->nv, d->qvel);
    derive();
    std::copy(end_velocity_.begin(), end_velocity_.end(), d->qvel);
  };
  // There MuJoCo has left derivatives of the bias too.
  if (m->opt.integrator == mjINT_IMPLICIT)
    derive_at_start([&] { prepare_effective_inertia(m, d); });
  for (int index = 0; index < count; ++index)
    if ((*motion.touched)[index] && brakes(trees.tree[index]))
      kept_[index] = kept_change(m, d, trees.tree[index], motion);
  const auto add_braking = [&](std::vector<Braking>& to, double sign) {
    for (int index = 0; index < count; ++index)
      if (brakes(trees.tree[index]))
        to[group[index]] += implicit_braking(m, d, trees.tree[index], kept_[index], sign, motion);
  };
  if (!takes_derivatives(m) || m->nu == 0 || (m->opt.disableflags & mjDSBL_ACTUATION))
    return add_braking(dampers_, 1.0);
  // Of actuators: all less that of dampers.
  add_braking(actuators_, 1.0);
  derive_at_start([&] {
    mju_zero(d->qDeriv, m->nD);
    mjd_passive_vel(m, d);
  });
  add_braking(actuators_, -1.0);
  add_braking(dampers_, 1.0);
}

// s of a tree that rows moved.
double SmoothWork::kept_change(const mjModel_* m, const mjData_* d, const Tree& t,
                               const StepMotion& motion) const {
  const auto norm = [&](const double* v) {
    return std::sqrt(std::max(0.0, damping_form(m, d, t, motion.start_velocity, v, v)));
  };
  const double size = norm(change_.data());
  if (size == 0.0) return 1.0;
  const double even = size - 2.0 * norm(unevenness_.data());
  const double smooth = m->opt.timestep * norm(motion.acceleration);
  return std::clamp(std::max(even, smooth) / size, 0.0, 1.0);
}

SmoothWork::Braking SmoothWork::implicit_braking(const mjModel_* m, const mjData_* d, const Tree& t,
                                                 double kept, double sign,
                                                 const StepMotion& motion) const {
  const int tree = m->dof_treeid[t.dof_begin];
  const auto form = [&](const double* u, const double* v) {
    return sign * damping_form(m, d, t, motion.start_velocity, u, v);
  };
  const double* change = change_.data();
  const double integrated =
      m->opt.timestep * (form(change, motion.start_velocity) + 0.5 * form(change, change));
  if (!(*motion.touched)[tree]) return {integrated, integrated};
  const double mean = form(motion.displacement, mean_change_.data());
  if (motion.end) return {integrated, 2.0 * mean};
  return {integrated, mean + 0.5 * kept * form(motion.displacement, change)};
}

// Work of all other smooth forces less the gain of kinetic energy: what dampers and rows took.
void SmoothWork::find_losses(const mjModel_* m, const mjData_* d, const Trees& trees,
                             const StepMotion& motion) {
  lost_.assign(trees.tree.size(), 0.0);
  momentum_.resize(m->nv);
  mj_mulM(m, d, momentum_.data(), change_.data());
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    const Tree& t = trees.tree[index];
    double& lost = lost_[group[index]];
    lost -= actuators_[index].integrated;
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
      lost += undamped_force_[i] * motion.displacement[i] -
              (motion.start_velocity[i] + 0.5 * change_[i]) * momentum_[i];
  }
}

double smooth_force(const mjData_* d, int dof) { return d->qfrc_smooth[dof]; }

double damping_force(const mjData_* d, int dof) { return d->qfrc_damper[dof] + d->qfrc_fluid[dof]; }

double driving_force(const mjData_* d, int dof) {
  return d->qfrc_smooth[dof] + d->qfrc_bias[dof] - d->qfrc_spring[dof] - damping_force(d, dof);
}

double positional_force(const mjData_* d, int dof) {
  return d->qfrc_spring[dof] + d->qfrc_gravcomp[dof] - d->qfrc_bias[dof];
}

double potential_force(const mjModel_* m, const mjData_* d, int dof) {
  const double force = d->qfrc_spring[dof] + d->qfrc_gravcomp[dof];
  if (m->opt.disableflags & mjDSBL_GRAVITY) return force;
  return force + weight_of_subtree(m, d, dof);
}

void times_inertia(const mjModel_* m, const mjData_* d, const double* x, double* product) {
  mj_mulM(m, d, product, x);
}

double potential_work(const mjModel_* m, const mjData_* d, const double* displacement) {
  const bool gravity = !(m->opt.disableflags & mjDSBL_GRAVITY);
  double work = 0.0;
  for (int i = 0; i < m->nv; ++i) {
    if (displacement[i] == 0.0) continue;
    work += d->qfrc_spring[i] * displacement[i];
    if (gravity) work += weight_of_subtree(m, d, i) * displacement[i];
  }
  return work;
}

}  // namespace dashpot::host
