// How contacts between the same two bodies share a load, and how they are damped.
//
// Rigid ones have one stiffness, k = kappa / w with the mean w of those that do not stay open.
// Statics leaves open how feet of one body share its weight. By a w of their own those near the
// centre of mass would bear most, and wheels turn about inner rims. Parts of a flex count each.
//
// A damping ratio, and the restitution that follows from it, belongs to a vibration. That of one
// contact alone has the square frequency w k. A body that lands flat vibrates on all of its
// contacts at once: with compressions x and stiffnesses k it stores x'Kx / 2, and
//
//     omega^2 = x'K A Kx / x'Kx,      A = J inv(M) J' of the normals,      K = diag(k)
//
// (Rayleigh's quotient: exact where x is a mode, as where a body lands without turning). Damping in
// proportion to stiffness, d = 2 zeta k / omega, gives this mode the ratio zeta, and one contact
// alone d = 2 zeta sqrt(k / w).
//
// x is the overlap to which the velocities of the start lead from the onset of the first contact
// on, half way to the end of the step or to 1 / sqrt(w k) after it: a corner that comes first is
// alone, and short steps see the overlap there is.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Fills RowGroup::pair_inverse_mass and first_of_pair of contacts that are on no solref, and
// RowGroup::pressed of those whose material gives a damping ratio (rigid ones: a restitution), for
// a step of `length` (s) from the velocities in `data`. `compression`, by group: x of the contacts
// of a pair, any where none is pressed with others.
void damp_modes(const mjModel_* model, const std::vector<GroupMaterial>& materials,
                const std::vector<ContactInput>& contacts, const Trees& trees,
                const std::vector<char>& stays_open, const RowData& data, double length, Rows& rows,
                std::vector<double>& compression);

}  // namespace dashpot
