// Contact queries: signed distance and time of impact of two shapes, and close pairs among many.
// Free functions without state: safe from any number of threads.

#pragma once

#include <stdexcept>
#include <vector>

#include "dashpot/geometry/convex_distance.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Signed distance of two shapes: positive apart, negative by the penetration depth (the shortest
// translation that parts them). Closed forms for planes against anything and for spheres, capsules
// and boxes where these are short; else closest points, and the expanding polytope with refinement
// where the shapes overlap. Where several directions are equally short (concentric balls), one of
// them. A height field gives the least of the signed distances of its prisms (height_field.hpp).
// Throws std::invalid_argument for two planes or two height fields, or a height that is not finite.
Distance distance(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2);

// The gap (m) of two shapes with cores along a `normal` (unit, world, 1 to 2): they are no nearer.
double gap_along(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2,
                 const Eigen::Vector3d& normal);

// Whether two shapes are more than `clearance` (m, >= 0) apart. May be false for height fields
// that are.
bool are_farther_apart(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                       const Pose& pose2, double clearance);

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
// overlapping pairs come before all others. Pairs of planes and of height fields are left out.
std::vector<ClosePair> closest_pairs(const std::vector<PlacedShape>& shapes, double radius);

// Gap that counts as contact, relative to the size of the bounded shapes of a pair.
constexpr double kTouchingGap = 1e-9;

// Distances that a search for a first contact may compute: it takes tens, and more only where
// shapes hover about kTouchingGap apart. With a height field, where every prism near the shape is
// searched for, as many as this and parts of the way that are looked at.
constexpr int kMostDistances = 10000;
constexpr int kMostDistancesToField = 1000000;

// No first contact was found, and none excluded, in so many distances.
struct UndecidedImpact : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// First contact of two moving shapes.
struct TimeOfImpact {
  bool hit = false;     // false: apart over the whole horizon
  double time = 0.0;    // s, of first contact; the horizon without a hit
  Distance at;          // signed distance at `time`
  int evaluations = 0;  // distances computed
};

// Conservative advancement: `time` is never after the first contact, and precedes it by no more
// than the shapes need to close kTouchingGap. Shapes that touch or overlap at the start have time
// 0. `horizon` (s) > 0. Throws std::invalid_argument as distance(), for a plane that turns and for
// height fields where anything accelerates; UndecidedImpact. With `margin` (m, >= 0), the time at
// which the distance has fallen to it takes the place of the first contact.
TimeOfImpact time_of_impact(const Shape& shape1, const Pose& pose1, const Motion& motion1,
                            const Shape& shape2, const Pose& pose2, const Motion& motion2,
                            double horizon, double margin = 0.0);

}  // namespace dashpot
