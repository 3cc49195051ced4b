// Contacts of geoms that lie flat on each other, as the points of their faces.

#pragma once

#include "dashpot/detect/geom_faces.hpp"

struct mjModel_;
struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Puts the points of the faces in place of the `count` contacts (at most mjMAXCONPAIR) that MuJoCo
// finds of two geoms, where these lie flat on each other; returns how many they are, 0 where they
// do not. Pairs of boxes, meshes, flat ends of cylinders and planes, of two boxes, and of capsules
// on boxes, only where MuJoCo finds a single point; and round sides on faces. Of a capsule on a box
// MuJoCo finds one end alone in half of all cases where it is parallel but for rounding.
int take_points_of_faces(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                         FaceBuffers& buffers, mjPreContact_* contact, int count);

}  // namespace dashpot::host
