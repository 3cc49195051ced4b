// Penetration depth by the expanding polytope algorithm (van den Bergen 2001).
//
// A polytope of support points grows inside the difference of the two cores. Its face nearest to
// the origin bounds the depth from below, the support point along that face's normal from above;
// the support point joins the polytope until the bounds meet. The polytope need not hold the origin
// at the start: a face that has the origin outside has a negative offset and is the first to grow.

#pragma once

#include <optional>

#include "dashpot/geometry/convex_distance.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

struct Penetration {
  Distance distance;   // distance.distance is proven along distance.normal; points where exact
  double bound = 0.0;  // m: the signed distance lies between distance.distance and this
  bool exact = false;  // the bounds met, at points of both cores
};

// Penetration of two overlapping cores: bounds that meet to 1e-10 of the cores' size, or to 1e-5
// where many directions are nearly as short. Empty where the difference of the cores is flat.
std::optional<Penetration> expand_polytope(const Shape& shape1, const Pose& pose1,
                                           const Shape& shape2, const Pose& pose2);

}  // namespace dashpot
