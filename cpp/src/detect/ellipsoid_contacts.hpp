// Contacts of ellipsoids where a closed form or Newton's method gives them.
//
// An ellipsoid of the half-axes a, turned by R, reaches h = sqrt(n' S n) along a unit direction n,
// S = R diag(a^2) R', in the point grad h = S n / h. With the centres c apart, the surfaces are
//
//     s(n) = n (c - grad h_1 - grad h_2)
//
// apart along n, and the distance, negative in overlap, is the largest of these. There the vector
// between both points lies along n: its part t across n vanishes, and by Newton
//
//     (H_1 + H_2 + s) dn = t ,   H = (S - grad h grad h') / h ,
//
// in the plane across n. A search for the nearest points by hulls ends with a tolerance on s, whose
// root is left of n: of two balls in overlap it was off by up to 0.05 rad, and what rocks on a wide
// plate loses energy by such a scatter.

#pragma once

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

// Puts in place of the contact that a search found of an ellipsoid with another geom the nearest
// points of two ellipsoids, or the lowest point over the face of a box or the flat end of a
// cylinder. Others stay.
void improve_ellipsoid_contact(const mjModel_* m, const mjData_* d, int ellipsoid, int other,
                               mjPreContact_& contact);

}  // namespace dashpot::host
