// Smooth forces, inertia and energy that the last step computed, and work over a step.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

// Smooth force on a degree of freedom at the start of the last step, N or N m: all of it; what
// follows from positions and velocities alone: bias, springs and gravity compensation; the part of
// this that has a potential, from gravity, springs and gravity compensation.
double smooth_force(const mjData_* d, int dof);
double positional_force(const mjData_* d, int dof);
double potential_force(const mjModel_* m, const mjData_* d, int dof);
// Of that, what springs have.
double spring_force(const mjData_* d, int dof);
// Of all degrees of freedom (nv): of dampers, fluids; of actuators, applied, compensated gravity.
void damping_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force);
void driving_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force);
// The driving forces but gravity compensation (nv): with implicit integrators those of dampers too,
// with others without strong explicit damping of servos. At the start of a step from `velocity`.
void drives(const mjModel_* m, const mjData_* d, const std::vector<double>& velocity,
            std::vector<double>& force);
// What an actuator's force falls by with its length, N/m or N m/rad: of servos, whose bias is
// affine in it, unless their group is disabled or their force is at the end of its range.
double servo_stiffness(const mjModel_* m, const mjData_* d, int actuator);
// What the forces of actuators (nv) change by, to first order, because joints move by a
// `displacement` (nv): those of servos, whose bias is affine in the actuator's length, where their
// force is not at the end of its range.
void servo_changes(const mjModel_* m, const mjData_* d, const double* displacement,
                   std::vector<double>& change);
// M x in generalized coordinates (nv), with the inertia last computed.
void times_inertia(const mjModel_* m, const mjData_* d, const double* x, double* product);

// Work (J) of gravity and passive springs over a displacement (nv) from where the step started.
double potential_work(const mjModel_* m, const mjData_* d, const double* displacement);

// Kinetic and potential energy of the present state, J, with flexes'. Overwrites the last step's.
std::array<double, 2> mechanical_energy(const mjModel_* m, mjData_* d);

// Work of the smooth forces over a step.
//
// A step solves (M + H D) dv = f dt + J'dp with f the smooth forces at its start, D what the
// effective inertia has of dampers and actuators (model/effective_inertia.hpp) and p the impulses
// of the rows, which may come at any time in it. So
//
//     v(t) = v0 + a t + u(t),    a = inv(M + H D) f,    u = inv(M + H D) J'p,
//     change of v'M v / 2 = f'x + (work of the rows) - H (v1' D v1 - v0' D v0) / 2
//
// with x the displacement, the integral of v. Without rows x = H (v0 + v1) / 2, and of f = -D v0
// these terms take H v1' D (v0 + v1) / 2, what a damper of force D v1 dissipates.
//
// Dampers of damped trees (trees.hpp) brake at the velocities that there are, but for the part
// e D in H: they take, as counted in the micro-steps, with g the damping force at v0,
//
//     integral of v'D (v - v0) dt - x'g  +  e (v1'D v1 - v0'D v0) / 2 .
//
// The last term gives back what rows that change the velocity within a moment do as if e D were
// inertia. So of a hit on a tree that dampers would stop within a step, some hundredths go to the
// rows that are theirs.

// How a step moved: generalized velocity at its start, displacement that the change of kinetic
// energy goes with (the integral of velocity, or H (v0 + v1) / 2 where MuJoCo's integrator moved
// the tree), smooth acceleration (nv each); by tree whether it went as in the micro-steps.
struct StepMotion {
  const double *start_velocity, *displacement, *acceleration;
  const std::vector<char>* in_microsteps;
  const double* braked;  // RowData::braked
};

// Work (J) over a step that has just been integrated: of dampers and fluids, and of actuators,
// applied forces and gravity compensation. Keeps its arrays from step to step.
class SmoothWork {
 public:
  void find(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion);

  double damping = 0.0, applied = 0.0;

 private:
  void find_mean_forces(const mjModel_* m, const mjData_* d, const Trees& trees,
                        const StepMotion& motion);
  void find_braking(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion);
  static double work_of_drag(const mjModel_* m, const mjData_* d, const Trees& trees,
                             const Tree& tree, const StepMotion& motion);
  // What the terms of the integrator take from the motion of a tree (J) by the present D.
  double implicit_braking(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                          const StepMotion& motion) const;

  // By degree of freedom: v1 - v0, (v0 + v1) / 2, v1; means over the step of driving forces, and of
  // dampers less what the effective inertia takes of them.
  std::vector<double> change_, mean_velocity_, end_velocity_, driving_force_, damping_force_;
  std::vector<double> gravity_room_;
};

}  // namespace dashpot::host
