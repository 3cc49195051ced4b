// Smooth forces, inertia and energy that the last step computed.

#pragma once

#include <array>
#include <vector>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Smooth force on a degree of freedom at the start of the last step, N or N m: all of it; what
// follows from positions and velocities alone: bias, springs and gravity compensation; the part of
// this that has a potential, from gravity, springs and gravity compensation.
double smooth_force(const mjData_* d, int dof);
double positional_force(const mjData_* d, int dof);
double potential_force(const mjModel_* m, const mjData_* d, int dof);
// Of that, what springs have.
double spring_force(const mjData_* d, int dof);
// Those of all degrees of freedom (nv): of dampers and fluids; of actuators, applied forces and
// gravity compensation.
void damping_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force);
void driving_forces(const mjModel_* m, const mjData_* d, std::vector<double>& force);
// The driving forces but gravity compensation (nv): with implicit integrators those of dampers too,
// with others without explicit damping of servos that is strong for the step. At the start of a
// step from `velocity`.
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

// Kinetic and potential energy of the present state, J, with what flexes store. Overwrites what the
// last step computed.
std::array<double, 2> mechanical_energy(const mjModel_* m, mjData_* d);

}  // namespace dashpot::host
