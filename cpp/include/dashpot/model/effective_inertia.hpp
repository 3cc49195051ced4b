// The inertia through which rows act: M + H D, with D by integrator.
//
//     Euler, RK4     joint damping, as MuJoCo's Euler treats it implicitly
//     implicitfast   minus the symmetric derivatives of all smooth forces but the bias, as MuJoCo
//     implicit       the same; the derivative of the bias, which is not symmetric, is left out
//     discrete       of springs, dampers, servos, drag and flexes, with H^2 K (discrete.hpp)
//
// Dampers of a linked tree act in its micro-steps (microstep.hpp), and e D is left in the inertia,
// with e = H / 4 of one that rows held in the last step, and H / 26 in flight. So do the springs of
// `discrete`, of which D has H K.

#pragma once

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/rows/trees.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

// Whether D comes from derivatives.
bool takes_derivatives(const mjModel_* m);

// u' D v of vectors by degree of freedom (nv) over those of a tree; joint damping is that of the
// step's start, which find_effective_inertia has found.
double damping_form(const mjModel_* m, const mjData_* d, const Trees& trees, const Tree& tree,
                    const double* u, const double* v);

// The same D of one degree of freedom.
double damping_of(const mjModel_* m, const mjData_* d, const Trees& trees, int dof);

// Adds D v of the damping of actuators, of an integrator that treats it explicitly, for the degrees
// of freedom where it takes more than half of their velocity in a step.
void add_strong_damping(const mjModel_* m, const mjData_* d, const double* v, double* product);

// Computes the derivatives where they are needed: of all smooth forces, or of actuators alone, or
// takes over those of `discrete`.
void prepare_effective_inertia(const mjModel_* m, mjData_* d, Trees& trees);
// Finds the effective inertia of every tree: the inverse for free bodies, for others the factor of
// factor_inertia. Derivatives that leave none are changed, see springs_and_dampers.hpp. `parts` as
// read_welded_parts leaves them. Throws DivergenceError, naming a joint, where M is singular.
void find_effective_inertia(const mjModel_* m, mjData_* d, const std::vector<WeldedParts>& parts,
                            Trees& trees, Team& team);
// Of a sparse tree whose springs couple its bodies: the factor of H, unless the step has it.
void find_coupled_inertia(const mjModel_* m, const mjData_* d, int tree, Trees& trees);
// Of a tree that rows may hold, after its smooth acceleration is known: finds D for its
// micro-steps, and the factor with what is left of H D. Not of free bodies.
void damp_in_microsteps(const mjModel_* m, const mjData_* d, int tree, bool is_held, Trees& trees);
// x = inv(M + e D) x over the degrees of freedom of a tree whose springs are not in H, with another
// e than the tree has now: `implicit_time` (s).
void solve_damped(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                  double implicit_time, double* x);
// The smooth generalized acceleration of a tree through the effective inertia. That of a free body,
// and of trees whose derivatives were changed, goes through all derivatives as they are, as in
// MuJoCo: lift and drag of a fluid couple how a body goes with how it turns, and not symmetrically.
void smooth_acceleration(const mjModel_* m, const mjData_* d, Trees& trees, int tree,
                         double* acceleration);

}  // namespace dashpot::host
