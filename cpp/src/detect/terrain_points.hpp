// Contacts of the points with which a geom lies on a height field.
//
// They are corners of boxes and meshes, points of the rims of cylinders that stand and the ends of
// the lowest line of those that lie, the balls at the ends of capsules, the lowest point of an
// ellipsoid or a ball, over the triangle beneath it; of round surfaces over those beside that rise
// from it, too.
//
// What rolls in a groove or a bowl hits the triangle that rises before it. So triangles in which a
// round surface lies deeper at the end of the step, at the velocities of its start, are touched as
// planes too. One that is softer than that, and over several triangles at once, is borne by the
// deepest alone (terrain_contacts.hpp).

#pragma once

#include "dashpot/geometry/terrain_contacts.hpp"
#include "geom_on_terrain.hpp"

namespace dashpot::host {

void add_own_points(const GeomOnTerrain& geom, TerrainContacts& found);

// Those of round surfaces with triangles in which they lie deeper where the geom is in the pose
// `end` (frame of the field), that of the end of the step. Their planes are no less far than what
// is found already: triangles that rise from those.
void add_coming_points(const GeomOnTerrain& geom, const Pose& end, TerrainContacts& found);

}  // namespace dashpot::host
