// Contacts with height fields.
//
// MuJoCo collides a geom with every prism beneath it, each of which gives the point where it is
// deepest: of a box that lies on flat ground any point on each, another one in every step, and
// along the sides that prisms have in common any normal.
//
// A geom touches a surface of triangles in points of its own on faces, and in corners and edges of
// the surface that stand out. The first are known. Of what MuJoCo finds remains what lies on
// corners and edges that stand out, or is not explained; of round surfaces no more than what has a
// normal there that leads out of the surface.
//
// Points of geoms are corners of boxes and meshes, points of the rims of cylinders that stand and
// the ends of the lowest line of those that lie, the balls at the ends of capsules, the lowest
// point of an ellipsoid or a ball, over the triangle beneath it; of round surfaces over those
// beside that rise from it, too.
//
// What rolls in a groove or a bowl hits the triangle that rises before it. So triangles in which a
// round surface lies deeper at the end of the step, at the velocities of its start, are touched as
// planes too. One that is softer than that, and over several triangles at once, is borne by the
// deepest alone (terrain.hpp).

#pragma once

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

struct FaceBuffers;

// Puts these contacts in place of the `count` (at most mjMAXCONPAIR) that MuJoCo finds of a height
// field and another geom within `margin` (m); returns how many they are.
int take_points_on_terrain(const mjModel_* m, mjData_* d, int terrain, int geom, double margin,
                           FaceBuffers& buffers, mjPreContact_* contact, int count);

}  // namespace dashpot::host
