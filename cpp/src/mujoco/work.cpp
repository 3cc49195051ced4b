#include "dashpot/mujoco/work.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "dashpot/mujoco/discrete.hpp"
#include "dashpot/mujoco/effective_inertia.hpp"
#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/host.hpp"

extern "C" {
void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);
void mjd_passive_vel(const mjModel* m, mjData* d);
}

namespace dashpot::host {

namespace {

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

}  // namespace

void SmoothWork::find(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion) {
  damping = applied = 0.0;
  find_mean_forces(m, d, trees, motion);
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

void SmoothWork::find_mean_forces(const mjModel_* m, const mjData_* d, const Trees& trees,
                                  const StepMotion& motion) {
  damping_forces(m, d, damping_force_);
  driving_forces(m, d, driving_force_);
  undamped_force_.resize(m->nv);
  for (int i = 0; i < m->nv; ++i) {
    undamped_force_[i] = d->qfrc_smooth[i] - damping_force_[i];
    if (!motion.spring_change.empty()) undamped_force_[i] += motion.spring_change[i];
  }
  // What implicit springs lack of their force at the start, they take as dampers do.
  for (size_t index = 0; index < trees.tree.size(); ++index)
    add_stiffness_shift(m, trees, index, motion.start_velocity, damping_force_.data());
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
  if (m->opt.integrator == mjINT_IMPLICIT) derive_at_start([&] { mjd_smooth_vel(m, d, 0); });
  for (int index = 0; index < count; ++index)
    if ((*motion.touched)[index] && brakes(trees.tree[index]))
      kept_[index] = kept_change(m, d, trees, trees.tree[index], motion);
  const auto add_braking = [&](std::vector<Braking>& to, double sign) {
    for (int index = 0; index < count; ++index)
      if (brakes(trees.tree[index]))
        to[group[index]] += implicit_braking(m, d, trees, index, kept_[index], sign, motion);
  };
  if (!takes_derivatives(m) || m->nactuator == 0 || (m->opt.disableflags & mjDSBL_ACTUATION))
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
double SmoothWork::kept_change(const mjModel_* m, const mjData_* d, const Trees& trees,
                               const Tree& t, const StepMotion& motion) const {
  const auto norm = [&](const double* v) {
    return std::sqrt(std::max(0.0, damping_form(m, d, trees, t, v, v)));
  };
  const double size = norm(change_.data());
  if (size == 0.0) return 1.0;
  const double even = size - 2.0 * norm(unevenness_.data());
  const double smooth = m->opt.timestep * norm(motion.acceleration);
  return std::clamp(std::max(even, smooth) / size, 0.0, 1.0);
}

// What the drag of a tree took, and of each degree of freedom the part that the present D has in
// it.
double SmoothWork::work_of_drag(const mjModel_* m, const mjData_* d, const Trees& trees,
                                const Tree& t, double sign, const StepMotion& motion) {
  double work = 0.0;
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    const double all = trees.damping[t.begin + i];
    const double part = all != 0.0 ? damping_of(m, d, trees, dof) / all : 1.0;
    work += part * motion.braked[t.begin + i];
  }
  return sign * work;
}

SmoothWork::Braking SmoothWork::implicit_braking(const mjModel_* m, const mjData_* d,
                                                 const Trees& trees, int tree, double kept,
                                                 double sign, const StepMotion& motion) const {
  const Tree& t = trees.tree[tree];
  const auto form = [&](const double* u, const double* v) {
    return sign * damping_form(m, d, trees, t, u, v);
  };
  const double* change = change_.data();
  // v'D v / 2 of v0 + `by`, less that of v0.
  const auto gain = [&](const double* by) {
    return form(by, motion.start_velocity) + 0.5 * form(by, by);
  };
  const double step = m->opt.timestep, gained = gain(change);
  double integrated = step * gained;
  if (!(*motion.in_microsteps)[tree]) {
    if (is_runge_kutta(m)) integrated = 0.0;
    return {integrated, integrated};
  }
  if (t.damped) {
    const double dragged =
        work_of_drag(m, d, trees, t, sign, motion) +
        (step - trees.implicit_time) * form(motion.acceleration, motion.displacement);
    const double as_inertia = trees.implicit_time * gained;
    return {dragged + as_inertia, dragged + kept * as_inertia};
  }
  const double mean = form(motion.displacement, mean_change_.data());
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

}  // namespace dashpot::host
