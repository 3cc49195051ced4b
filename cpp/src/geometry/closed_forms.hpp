// Signed distances between cores that have a short closed form.

#pragma once

#include <optional>

#include "dashpot/geometry/convex_distance.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Exact signed distance of two cores where there is a closed form: a plane against anything else;
// point or segment against point or segment; point against box or cylinder. Empty for other pairs.
std::optional<Distance> closed_form_distance(const Shape& shape1, const Pose& pose1,
                                             const Shape& shape2, const Pose& pose2);

}  // namespace dashpot
