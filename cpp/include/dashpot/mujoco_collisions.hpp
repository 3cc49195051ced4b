// Collisions of MuJoCo that detection replaces. Part of the mujoco_host room.
//
// Boxes: MuJoCo finds nothing between boxes that are apart and face each other with corners or
// edges. Under a widened reach such contacts may start in the step: that of the nearest points.
//
// Boxes that lie flat on each other: of two faces tilted by a hair MuJoCo finds one crossing of
// their edges in some steps. There the contacts are all points that the faces share, see
// flat_boxes.hpp; but for the complementarity-free law, which is published with what MuJoCo finds.
//
// Capsules, cylinders, boxes and meshes: MuJoCo finds the nearest points and, of shapes that face
// each other, others at about the same distance. Of a body that turns fast another one may come
// faster. Where geoms move far in a step, points that overlap at its end, at the velocities of its
// start, are contacts too, with the gap that they have now.
//
// Cylinder on plane: MuJoCo takes the lowest direction of the rim from the difference of nearly
// equal vectors. Of a cylinder that stands flat, tilted by a, distances are off by about 1e-16 / a
// radii: 90 um of a disc of 10 cm at 1e-12 rad, 57 mm at 1e-15. And its points jump about the rim
// as a tilt of any size turns. Below a tilt that tells distances apart by a millionth of the
// radius, three points that are fixed to the cylinder stand for its rim.

#pragma once

namespace dashpot::host {

// While it lives, collisions of this thread are those; others stay as they are.
class ReplacedCollisions {
 public:
  explicit ReplacedCollisions(bool faces_of_flat_boxes);
  ~ReplacedCollisions();
  ReplacedCollisions(const ReplacedCollisions&) = delete;
  ReplacedCollisions& operator=(const ReplacedCollisions&) = delete;

 private:
  bool outer_, outer_faces_;  // a callback of collision may step another model
};

}  // namespace dashpot::host
