// Contacts of ellipsoids where a closed form or Newton's method gives them.
//
// A search for the nearest points ends with a tolerance on their distance, of 1e-9 m and of the
// sizes of both geoms: its root is left of the normal, and by a slope of that the point moves along
// the surface. What rocks on a wide plate lost a fifth of its energy in 5 s by such a scatter.

#pragma once

struct mjModel_;
struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Puts in place of the contact that a search found of an ellipsoid with another geom the nearest
// points of two ellipsoids (ellipsoids.hpp), or the lowest point over the face of a box or the flat
// end of a cylinder. Others stay.
void improve_ellipsoid_contact(const mjModel_* m, const mjData_* d, int ellipsoid, int other,
                               mjPreContact_& contact);

}  // namespace dashpot::host
