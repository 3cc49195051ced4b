// Rows in the coordinates in which the inertia of a tree is 1 (MassWeighted of rows.hpp).

#pragma once

#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Appends room for the mass-weighted rows of a group with sparse rows: the columns that they reach
// in every tree that is no free body, and zeros.
void append_mass_weighted(Rows& rows, RowGroup& group, const Trees& trees);
// Fills in those over one of its trees, whose factor is known; `inverse_mass` (dim): the diagonal
// of y y'. Groups may be filled in at once by several threads.
void weight_by_mass(Rows& rows, const RowGroup& group, int side, const Trees& trees,
                    double* inverse_mass);

// In place, over the degrees of freedom of a tree whose factor is known: y = j inv(D^1/2 L) of a
// row j, z = D^1/2 L x of a motion x, for which y z = j x and z'z = x'H x, and x of such a z.
void weight_row(const Trees& trees, int tree, double* row);
void weight_motion(const Trees& trees, int tree, double* motion);
void unweight_motion(const Trees& trees, int tree, double* motion);

}  // namespace dashpot
