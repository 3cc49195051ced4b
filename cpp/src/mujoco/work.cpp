#include "dashpot/mujoco/work.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/mujoco/discrete.hpp"
#include "dashpot/mujoco/effective_inertia.hpp"
#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/gravity_ahead.hpp"
#include "dashpot/mujoco/host.hpp"

extern "C" {
void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);
void mjd_passive_vel(const mjModel* m, mjData* d);
}

namespace dashpot::host {

namespace {

// Whether the integrator treats any force on a tree implicitly.
bool brakes(const Tree& t) { return !t.free_body; }

}  // namespace

void SmoothWork::find(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion) {
  damping = applied = 0.0;
  find_mean_forces(m, d, trees, motion);
  for (int i = 0; i < m->nv; ++i) {
    damping += damping_force_[i] * motion.displacement[i];
    applied += driving_force_[i] * motion.displacement[i];
  }
  find_braking(m, d, trees, motion);
}

void SmoothWork::find_mean_forces(const mjModel_* m, const mjData_* d, const Trees& trees,
                                  const StepMotion& motion) {
  damping_forces(m, d, damping_force_);
  driving_forces(m, d, driving_force_);
  // What implicit springs lack of their force at the start, they take as dampers do.
  for (size_t index = 0; index < trees.tree.size(); ++index)
    add_stiffness_shift(m, trees, index, motion.start_velocity, damping_force_.data());
  if (m->ngravcomp == 0) return;
  for (size_t index = 0; index < trees.tree.size(); ++index)
    if (!trees.tree[index].free_body)
      add_gravity_ahead(m, d, index, 0.5 * m->opt.timestep, Gravity::kOfCompensation, gravity_room_,
                        driving_force_.data());
}

void SmoothWork::find_braking(const mjModel_* m, mjData_* d, const Trees& trees,
                              const StepMotion& motion) {
  change_.resize(m->nv);
  for (int i = 0; i < m->nv; ++i) change_[i] = d->qvel[i] - motion.start_velocity[i];
  const auto derive_at_start = [&](const auto& derive) {
    end_velocity_.assign(d->qvel, d->qvel + m->nv);
    std::copy_n(motion.start_velocity, m->nv, d->qvel);
    derive();
    std::copy(end_velocity_.begin(), end_velocity_.end(), d->qvel);
  };
  // There MuJoCo has left derivatives of the bias too.
  if (m->opt.integrator == mjINT_IMPLICIT) derive_at_start([&] { mjd_smooth_vel(m, d, 0); });
  const auto all_braking = [&] {
    double sum = 0.0;
    for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index)
      if (brakes(trees.tree[index])) sum += implicit_braking(m, d, trees, index, motion);
    return sum;
  };
  const double all = all_braking();
  if (!takes_derivatives(m) || m->nactuator == 0 || (m->opt.disableflags & mjDSBL_ACTUATION)) {
    damping -= all;
    return;
  }
  // Of actuators: all less that of dampers.
  derive_at_start([&] {
    mju_zero(d->qDeriv, m->nD);
    mjd_passive_vel(m, d);
  });
  const double of_dampers = all_braking();
  damping -= of_dampers;
  applied -= all - of_dampers;
}

// What the drag of a tree took, and of each degree of freedom the part that the present D has in
// it.
double SmoothWork::work_of_drag(const mjModel_* m, const mjData_* d, const Trees& trees,
                                const Tree& t, const StepMotion& motion) {
  double work = 0.0;
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    const double all = trees.damping[t.begin + i];
    const double part = all != 0.0 ? damping_of(m, d, trees, dof) / all : 1.0;
    work += part * motion.braked[t.begin + i];
  }
  return work;
}

double SmoothWork::implicit_braking(const mjModel_* m, const mjData_* d, const Trees& trees,
                                    int tree, const StepMotion& motion) const {
  const Tree& t = trees.tree[tree];
  const auto form = [&](const double* u, const double* v) {
    return damping_form(m, d, trees, t, u, v);
  };
  const double* change = change_.data();
  const double gained =
      form(change, motion.start_velocity) + 0.5 * form(change, change);  // of v'D v / 2
  const double step = m->opt.timestep;
  if (t.damped)
    return work_of_drag(m, d, trees, t, motion) +
           (step - t.implicit_time) * form(motion.acceleration, motion.displacement) +
           t.implicit_time * gained;
  // The stages of RK4 see dampers themselves, in the mean at the mean velocity.
  const bool in_stages = is_runge_kutta(m) && !(*motion.in_microsteps)[tree];
  return (in_stages ? 0.5 : 1.0) * step * gained;
}

}  // namespace dashpot::host
