// Velocity derivatives with which no inertia is left.
//
// Implicit integrators step with M + h D, D = -dF/dv. Forces that grow with velocity, as those of
// fluids on plates or of drives with the wrong sign, make it indefinite where h is long. The smooth
// motion goes through it all the same, as in MuJoCo (effective_inertia.hpp). Rows need what is
// positive definite: for them D becomes diagonal, of each row the sum of the sizes of its entries,
// which is no less than D.

#pragma once

#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Changes the derivatives of a tree so that M + h D, h the time step, is positive definite if M is.
void keep_what_damps(const mjModel_* m, mjData_* d, int tree);

// The smooth acceleration of a tree by all of its derivatives, as MuJoCo finds it. False where they
// are all but singular.
bool solve_whole(const mjModel_* m, const mjData_* d, const Tree& t, double* acceleration);

}  // namespace dashpot::host
