// The Flexible Collision Library as a source of signed distances between convex cores. The only
// room that includes FCL.
//
// Used in the one mode that is right for every pair: `distance` with signed distance on the libccd
// solver at its default tolerance. Planes never come here (FCL's half-space crashes it).

#pragma once

#include <optional>

#include "dashpot/convex_distance.hpp"
#include "dashpot/shape.hpp"

namespace dashpot {

// Signed distance of two cores by GJK and the expanding polytope algorithm, good to about 1e-6 m.
// Empty where FCL gives up (degenerate simplices in its polytope).
std::optional<Distance> fcl_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                                     const Pose& pose2);

}  // namespace dashpot
