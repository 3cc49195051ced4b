#include "dashpot/query.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "dashpot/closed_forms.hpp"
#include "dashpot/fcl_shapes.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Relative to the size of the pair: bounds closer than this need no refinement.
constexpr double kCertain = 1e-11;
// FCL's polytope lies inside the difference of the cores, so it never overstates a depth; a refined
// depth that exceeds it by more than its own inaccuracy on curved faces was not the shortest.
constexpr double kPolytopeError = 1e-4;

// Penetration without a start: the best few of many directions, refined.
Distance search_penetration(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                            const Pose& pose2) {
  constexpr int kDirections = 256;
  constexpr int kRefined = 8;
  const double golden_angle = M_PI * (3.0 - std::sqrt(5.0));
  std::vector<std::pair<double, Vector3d>> candidates;
  for (int i = 0; i < kDirections; ++i) {  // Fibonacci sphere
    const double z = 1.0 - (2.0 * i + 1.0) / kDirections;
    const double radial = std::sqrt(1.0 - z * z);
    const Vector3d normal(radial * std::cos(golden_angle * i), radial * std::sin(golden_angle * i),
                          z);
    candidates.emplace_back(directional_distance(shape1, pose1, shape2, pose2, normal), normal);
  }
  std::partial_sort(candidates.begin(), candidates.begin() + kRefined, candidates.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  Distance best = refine_distance(shape1, pose1, shape2, pose2, candidates[0].second);
  for (int i = 1; i < kRefined; ++i) {
    const Distance found = refine_distance(shape1, pose1, shape2, pose2, candidates[i].second);
    if (found.distance > best.distance) best = found;
  }
  return best;
}

Distance core_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                       const Pose& pose2) {
  if (const auto closed = closed_form_distance(shape1, pose1, shape2, pose2)) return *closed;

  const double size = core_extent(shape1) + core_extent(shape2);
  const auto start = fcl_distance(shape1, pose1, shape2, pose2);
  if (start) {
    const double bound = directional_distance(shape1, pose1, shape2, pose2, start->normal);
    if (std::abs(start->distance - bound) <= kCertain * size) return *start;
  }
  const Vector3d between = pose2.position - pose1.position;
  const Vector3d direction = start                  ? start->normal
                             : between.norm() > 0.0 ? Vector3d(between.normalized())
                                                    : Vector3d::UnitZ();
  if (const auto apart = separated_distance(shape1, pose1, shape2, pose2, direction)) {
    return refine_distance(shape1, pose1, shape2, pose2, apart->normal);
  }
  if (start) {
    const Distance refined = refine_distance(shape1, pose1, shape2, pose2, direction);
    if (std::abs(refined.distance - start->distance) <= kPolytopeError * size) return refined;
  }
  return search_penetration(shape1, pose1, shape2, pose2);
}

}  // namespace

Distance distance(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2) {
  if (shape1.type == ShapeType::kPlane && shape2.type == ShapeType::kPlane) {
    throw std::invalid_argument("two planes have no finite distance");
  }
  Distance result = core_distance(shape1, pose1, shape2, pose2);
  const double radius1 = sweep_radius(shape1), radius2 = sweep_radius(shape2);
  result.distance -= radius1 + radius2;
  result.point1 += radius1 * result.normal;
  result.point2 -= radius2 * result.normal;
  return result;
}

}  // namespace dashpot
