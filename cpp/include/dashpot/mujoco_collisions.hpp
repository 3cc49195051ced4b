// Collisions of MuJoCo that detection replaces. Part of the mujoco_host room.
//
// Boxes: MuJoCo finds nothing between boxes that are apart and face each other with corners or
// edges, and one point between those that meet edge to edge. Under a widened reach such contacts
// may start in the step: those of the nearest points, and of corners above faces, one of which may
// come faster than the nearest point.
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
  ReplacedCollisions();
  ~ReplacedCollisions();
  ReplacedCollisions(const ReplacedCollisions&) = delete;
  ReplacedCollisions& operator=(const ReplacedCollisions&) = delete;

 private:
  bool outer_;  // a callback of collision may step another model
};

}  // namespace dashpot::host
