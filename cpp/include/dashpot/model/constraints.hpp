// Scalar constraints (equalities, dry friction, limits) as MuJoCo instantiates them.

#pragma once

#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

class RowTurns;

// Scalar constraints of the last detection, with the margins that the model sets.
void read_constraints(const mjModel_* m, const mjData_* d,
                      std::vector<ConstraintInput>& constraints);

// Whether solref (2) and solimp (5) are MuJoCo's defaults.
bool is_default_impedance(const double* solref, const double* solimp);

// dq_1/dq_2 of the polynomial that ties a joint, or the length of a tendon, to another one, in
// their units; 0 of other equalities, and where nothing is tied to.
double slope_of_equality(const mjModel_* m, const mjData_* d, int equality);

// dJ/dt xi of a row of an equality of bodies, joints, tendons or edges of a flex, in m/s^2 or
// rad/s^2: how fast its rate changes while the motion coordinates keep theirs. Leaves out what the
// other equalities of flexes keep.
double turning_of_equality(const mjModel_* m, const mjData_* d, int equality, int row,
                           const Trees& trees, const RowTurns& turns);

// A row over the generalized velocity of a free body (origin; rotation in its frame) becomes one
// over the velocity of its centre of mass and its angular velocity, in world axes.
void to_centre(const mjModel_* m, const mjData_* d, const Tree& tree, double* row);

}  // namespace dashpot::host
