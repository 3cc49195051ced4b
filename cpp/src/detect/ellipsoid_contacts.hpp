// Contacts of ellipsoids where a closed form or Newton's method gives them.
//
// A search for the nearest points ends with a tolerance on their distance: its root is left of the
// normal, and what rocks on a wide plate loses energy by such a scatter.

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
