// Work of the smooth forces over a step. Part of the mujoco_host room.
//
// A step solves (M + H D) dv = H f + J'p with f the smooth forces at its start and D what the
// integrator treats implicitly. Over the displacement x that goes with the change of kinetic
// energy, f does the work f'x, and D takes H (v1' D v1 - v0' D v0) / 2 besides: with x = H (v0 +
// v1) / 2 and f = -D v0 that is H v1' D (v0 + v1) / 2, what a damper of force D v1 dissipates.

#include <mujoco/mujoco.h>

#include <cmath>

#include "dashpot/mujoco_host.hpp"

extern "C" void mjd_passive_vel(const mjModel* m, mjData* d);

namespace dashpot::host {

namespace {

// v' D v with the Euler integrator's D, which it takes at the start of the step.
double diagonal_form(const mjModel* m, const double* v, const double* start_velocity) {
  double sum = 0.0;
  for (int i = 0; i < m->nv; ++i) sum += euler_damping(m, i, start_velocity[i]) * v[i] * v[i];
  return sum;
}

// Derivative of the damping force (c + c_1 |v| + c_2 v^2) v.
double damping_derivative(double damping, const mjtNum* high_order, double velocity) {
  double slope = damping, power = 1.0;
  for (int i = 0; i < mjNPOLY; ++i) {
    power *= std::abs(velocity);
    slope += (i + 2) * high_order[i] * power;
  }
  return slope;
}

// v' D v with D = -qDeriv, whose lower triangle M's sparsity maps.
double derivative_form(const mjModel* m, const mjData* d, const double* v) {
  double sum = 0.0;
  for (int i = 0; i < m->nv; ++i)
    for (int k = m->M_rowadr[i]; k < m->M_rowadr[i] + m->M_rownnz[i]; ++k) {
      const int j = m->M_colind[k];
      sum -= (i == j ? 1.0 : 2.0) * d->qDeriv[m->mapD2M[k]] * v[i] * v[j];
    }
  return sum;
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

double euler_damping(const mjModel_* m, int dof, double velocity) {
  double damping =
      damping_derivative(m->dof_damping[dof], m->dof_dampingpoly + mjNPOLY * dof, velocity);
  const int actuator = m->jnt_actuatorid[m->dof_jntid[dof]];
  if (actuator < 0) return damping;
  const double gear = m->actuator_gear[6 * m->actuator_outadr[actuator]];
  return damping + gear * gear *
                       damping_derivative(m->actuator_damping[actuator],
                                          m->actuator_dampingpoly + mjNPOLY * actuator, velocity);
}

SmoothWork smooth_work(const mjModel_* m, mjData_* d, const double* start_velocity,
                       const double* displacement) {
  SmoothWork work;
  for (int i = 0; i < m->nv; ++i) {
    const double damping = d->qfrc_damper[i] + d->qfrc_fluid[i];
    work.damping += damping * displacement[i];
    work.applied +=
        (d->qfrc_smooth[i] + d->qfrc_bias[i] - d->qfrc_spring[i] - damping) * displacement[i];
  }
  const double half = 0.5 * m->opt.timestep;
  if (m->opt.integrator == mjINT_IMPLICITFAST) {
    const double all = derivative_form(m, d, d->qvel) - derivative_form(m, d, start_velocity);
    double passive = all;
    if (m->nu > 0 && !(m->opt.disableflags & mjDSBL_ACTUATION)) {
      mju_zero(d->qDeriv, m->nD);
      mjd_passive_vel(m, d);
      passive = derivative_form(m, d, d->qvel) - derivative_form(m, d, start_velocity);
    }
    work.damping -= half * passive;
    work.applied -= half * (all - passive);
  } else if (!(m->opt.disableflags & (mjDSBL_EULERDAMP | mjDSBL_DAMPER))) {
    work.damping -= half * (diagonal_form(m, d->qvel, start_velocity) -
                            diagonal_form(m, start_velocity, start_velocity));
  }
  return work;
}

double smooth_force(const mjData_* d, int dof) { return d->qfrc_smooth[dof]; }

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
