// Rows in the coordinates in which the inertia of a tree is 1 (MassWeighted of rows.hpp).

#pragma once

#include "dashpot/rows.hpp"

namespace dashpot {

// Appends the mass-weighted rows of a group over one of its trees, which is no free body and whose
// factor is known; `inverse_mass` (dim): the diagonal of y y'.
void weight_by_mass(Rows& rows, RowGroup& group, int side, const Trees& trees,
                    double* inverse_mass);

}  // namespace dashpot
