// Cylinders that stand flat on planes.
//
// MuJoCo takes the lowest direction of the rim from the difference of nearly equal vectors. Of a
// cylinder that stands flat, tilted by a, distances are off by about 1e-16 / a radii: 90 um of a
// disc of 10 cm at 1e-12 rad, 57 mm at 1e-15. And its points jump about the rim as a tilt of any
// size turns. Below a tilt that tells distances apart by a millionth of the radius, three points
// that are fixed to the cylinder stand for its rim.

#pragma once

struct mjModel_;
struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Whether a cylinder is tilted so little against a plane.
bool stands_flat(const mjData_* d, int plane, int cylinder);
// The three contacts of the cap that faces the plane, those within `margin` (m); returns how many.
int touch_with_cap(const mjModel_* m, const mjData_* d, int plane, int cylinder, double margin,
                   mjPreContact_* contact);

}  // namespace dashpot::host
