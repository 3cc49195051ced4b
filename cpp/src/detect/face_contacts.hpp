// Contacts of geoms that lie flat on each other, as the points of their faces.
//
// And of capsules and cylinders that lie side by side, with each other or with the edge of a box or
// a mesh. MuJoCo gives the nearest points of the two, one contact unless the axes of capsules are
// parallel to rounding. Of axes that cross at a small angle theta, d apart, the gap along them is
//
//     g(x) = g_0 + m (x - x_0) + theta^2 (x - x_0)^2 / (2 d) ,   m = 0 between their ends,
//
// and a tilt by alpha takes the nearest point x_0 by alpha d / theta^2 along them: from end to end
// in a step, so that what is pressed there rocks for good. But a contact is as long as what it may
// sag by: to where the last term is a tolerance. Two points at the ends of that, with the gap g_0 +
// m (x - x_0), stand for it. An edge is an axis without a radius. Of edges that cross the gap grows
// by theta |x - x_0|: the nearest point stays where it is.

#pragma once

#include "dashpot/detect/geom_faces.hpp"

namespace dashpot::host {

// Puts the points of the faces in place of the `count` contacts (at most mjMAXCONPAIR) that MuJoCo
// finds of two geoms, where these lie flat on each other; returns how many they are, 0 where they
// do not. Pairs of boxes, meshes, flat ends of cylinders and planes, of two boxes, and of capsules
// on boxes, only where MuJoCo finds a single point; and round sides on faces. Of a capsule on a box
// MuJoCo finds one end alone in half of all cases where it is parallel but for rounding.
int take_points_of_faces(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                         FaceBuffers& buffers, mjPreContact_* contact, int count);

// Whether a type of geom has a straight side that is round: capsules and cylinders.
bool has_round_side(int type);

// Puts the ends of where two geoms touch, side by side, in place of the `count` contacts found;
// returns how many there are then, at most two of those within `margin` (m). The first geom has a
// round side, the second one, too, or it is a box or a mesh.
int take_ends_of_sides(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                       FaceBuffers& buffers, mjPreContact_* contact, int count);

}  // namespace dashpot::host
