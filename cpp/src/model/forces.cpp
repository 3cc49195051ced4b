#include "dashpot/model/forces.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/elastic_forces.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/velocities.hpp"
#include "discrete.hpp"

extern "C" {
void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);
void mjd_passive_vel(const mjModel* m, mjData* d);
}

namespace dashpot::host {

namespace {

double damping_force(const mjData* d, int dof) { return d->qfrc_damper[dof] + d->qfrc_fluid[dof]; }

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

// Groups of actuators that `disableactuator` has a bit for end here.
constexpr int kLastGroup = 30;

bool is_disabled(const mjModel* m, int actuator) {
  const int group = m->actuator_group[actuator];
  return group >= 0 && group <= kLastGroup && (m->opt.disableactuator & (1 << group));
}

// Whether the integrator treats any force on a tree implicitly.
bool brakes(const Tree& t) { return !t.free_body; }

}  // namespace

double servo_stiffness(const mjModel_* m, const mjData_* d, int actuator) {
  if (m->actuator_biastype[actuator] != mjBIAS_AFFINE || is_disabled(m, actuator)) return 0.0;
  if (m->actuator_forcelimited[actuator]) {
    const mjtNum force = d->actuator_force[m->actuator_outadr[actuator]];
    const mjtNum* range = m->actuator_forcerange + 2 * actuator;
    if (force <= range[0] || force >= range[1]) return 0.0;
  }
  return -m->actuator_biasprm[mjNBIAS * actuator + 1];
}

double smooth_force(const mjData_* d, int dof) { return d->qfrc_smooth[dof]; }

void damping_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force) {
  force.resize(m->nv);
  for (int i = 0; i < m->nv; ++i) force[i] = damping_force(d, i);
}

void driving_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force) {
  force.resize(m->nv);
  for (int i = 0; i < m->nv; ++i)
    force[i] = d->qfrc_smooth[i] + d->qfrc_bias[i] - d->qfrc_spring[i] - damping_force(d, i);
}

double positional_force(const mjData_* d, int dof) {
  return d->qfrc_spring[dof] + d->qfrc_gravcomp[dof] - d->qfrc_bias[dof];
}

double spring_force(const mjData_* d, int dof) { return d->qfrc_spring[dof]; }

double potential_force(const mjModel_* m, const mjData_* d, int dof) {
  const double force = d->qfrc_spring[dof] + d->qfrc_gravcomp[dof];
  if (m->opt.disableflags & mjDSBL_GRAVITY) return force;
  return force + weight_of_subtree(m, d, dof);
}

// Implicit integrators follow all dampers by their derivatives.
void drives(const mjModel_* m, const mjData_* d, const std::vector<double>& velocity,
            std::vector<double>& force) {
  if (is_discrete(m)) return force.assign(m->nv, 0.0);
  driving_forces(m, d, force);
  for (int i = 0; i < m->nv; ++i) force[i] -= d->qfrc_gravcomp[i];
  if (takes_derivatives(m))
    for (int i = 0; i < m->nv; ++i) force[i] += damping_force(d, i);
  else if (m->nactuator > 0)
    add_strong_damping(m, d, velocity.data(), force.data());
}

void servo_changes(const mjModel_* m, const mjData_* d, const double* displacement,
                   std::vector<double>& change) {
  change.assign(m->nv, 0.0);
  if (is_discrete(m)) return;
  if (m->opt.disableflags & mjDSBL_ACTUATION) return;
  for (int i = 0; i < m->nactuator; ++i) {
    const double stiffness = servo_stiffness(m, d, i);
    if (stiffness == 0.0) continue;
    const int output = m->actuator_outadr[i];
    const int first = d->moment_rowadr[output], last = first + d->moment_rownnz[output];
    double length = 0.0;
    for (int k = first; k < last; ++k)
      length += d->actuator_moment[k] * displacement[d->moment_colind[k]];
    for (int k = first; k < last; ++k)
      change[d->moment_colind[k]] -= stiffness * length * d->actuator_moment[k];
  }
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

std::array<double, 2> mechanical_energy(const mjModel_* m, mjData_* d) {
  d->flg_energypos = d->flg_energyvel = 0;
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  mj_comVel(m, d);
  mj_energyPos(m, d);
  mj_energyVel(m, d);
  return {d->energy[1], d->energy[0] + flex_energy(m, d)};
}

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
  mean_velocity_.resize(m->nv);
  for (int i = 0; i < m->nv; ++i) {
    change_[i] = d->qvel[i] - motion.start_velocity[i];
    mean_velocity_[i] = 0.5 * (d->qvel[i] + motion.start_velocity[i]);
  }
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

// What the drag of a tree took, and by degree of freedom the part that the present D has in it.
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
  const double gained = form(change_.data(), mean_velocity_.data());  // of v'D v / 2
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
