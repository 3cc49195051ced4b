// Rows in the coordinates in which the inertia of a tree is 1 (MassWeighted of rows.hpp).

#pragma once

#include "dashpot/rows.hpp"

namespace dashpot {

// Appends the mass-weighted rows of a group over one of its trees, which is no free body and whose
// factor is known; `inverse_mass` (dim): the diagonal of y y'.
void weight_by_mass(Rows& rows, RowGroup& group, int side, const Trees& trees,
                    double* inverse_mass);

// y y' of the first rows of two groups, each over its tree on one side: the rate of the one that an
// impulse of 1 on the other causes through a tree that both share. 0 where they share none, and
// where it is a free body.
double shared_inverse_mass(const Rows& rows, const RowGroup& a, int side_a, const RowGroup& b,
                           int side_b);

}  // namespace dashpot
