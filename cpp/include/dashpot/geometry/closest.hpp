// Close pairs among many placed shapes: broadphase, then signed distances.

#pragma once

#include <vector>

#include "dashpot/geometry/convex_distance.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

struct PlacedShape {
  Shape shape;
  Pose pose;
  int geom = 0;             // id that the answer names it by
  int group = 0;            // shapes of one group are fixed to each other and never a pair
  bool of_interest = true;  // at least one of a pair must be
};

struct ClosePair {
  int geom1 = 0, geom2 = 0;  // in the order of the placed shapes
  Distance distance;
};

// All pairs of different groups no further apart than `radius` (m, >= 0), nearest first;
// overlapping pairs come before all others. Pairs of planes and pairs of height
// fields are left out.
std::vector<ClosePair> closest_pairs(const std::vector<PlacedShape>& shapes, double radius);

}  // namespace dashpot
