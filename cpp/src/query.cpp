#include "dashpot/query.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "dashpot/closed_forms.hpp"
#include "dashpot/expanding_polytope.hpp"
#include "dashpot/height_field.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Relative to the size of the pair: a clearance whose direction the closest points give to 1e-12
// rad; bounds so far apart that rounding has torn the polytope.
constexpr double kClear = 1e-3;
constexpr double kTorn = 1e-3;

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
    const auto point = difference_support(shape1, pose1, shape2, pose2, normal);
    candidates.emplace_back(point.difference.dot(normal), normal);
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

// The direction in which a search begins.
Vector3d from_centre_to_centre(const Pose& pose1, const Pose& pose2) {
  const Vector3d between = pose2.position - pose1.position;
  const double offset = between.norm();
  return offset > 0.0 ? Vector3d(between / offset) : Vector3d::UnitZ();
}

Distance core_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                       const Pose& pose2) {
  if (const auto closed = closed_form_distance(shape1, pose1, shape2, pose2)) return *closed;

  const double size = core_extent(shape1) + core_extent(shape2);
  const Vector3d ahead = from_centre_to_centre(pose1, pose2);
  if (const auto apart = separated_distance(shape1, pose1, shape2, pose2, ahead)) {
    if (apart->distance > kClear * size) return *apart;
    return refine_distance(shape1, pose1, shape2, pose2, apart->normal);
  }
  if (const auto start = expand_polytope(shape1, pose1, shape2, pose2)) {
    if (start->exact) return start->distance;
    if (start->bound - start->distance.distance <= kTorn * size) {
      return refine_distance(shape1, pose1, shape2, pose2, start->distance.normal);
    }
  }
  return search_penetration(shape1, pose1, shape2, pose2);
}

bool is_height_field(const Shape& shape) { return shape.type == ShapeType::kHeightField; }

Distance field_distance(const HeightField& field, const Pose& field_pose, const Shape& shape,
                        const Pose& pose) {
  if (shape.type == ShapeType::kPlane) {
    return distance(height_field_hull(field), field_pose, shape, pose);
  }
  return height_field_distance(field, field_pose, shape, pose);
}

}  // namespace

Distance distance(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2) {
  if (shape1.type == ShapeType::kPlane && shape2.type == ShapeType::kPlane) {
    throw std::invalid_argument("two planes have no finite distance");
  }
  if (is_height_field(shape1) && is_height_field(shape2)) {
    throw std::invalid_argument("two height fields: queries do not cover this pair");
  }
  if (is_height_field(shape2)) return swapped(distance(shape2, pose2, shape1, pose1));
  if (is_height_field(shape1)) return field_distance(shape1.field, pose1, shape2, pose2);
  Distance result = core_distance(shape1, pose1, shape2, pose2);
  const double radius1 = sweep_radius(shape1), radius2 = sweep_radius(shape2);
  result.distance -= radius1 + radius2;
  result.point1 += radius1 * result.normal;
  result.point2 -= radius2 * result.normal;
  return result;
}

double gap_along(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2,
                 const Vector3d& normal) {
  return difference_support(shape1, pose1, shape2, pose2, normal).difference.dot(normal) -
         sweep_radius(shape1) - sweep_radius(shape2);
}

bool are_farther_apart(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                       const Pose& pose2, double clearance) {
  if (is_height_field(shape1) || is_height_field(shape2)) return false;
  const double of_cores = clearance + sweep_radius(shape1) + sweep_radius(shape2);
  if (const auto closed = closed_form_distance(shape1, pose1, shape2, pose2))
    return closed->distance > of_cores;
  const auto apart = separated_distance(shape1, pose1, shape2, pose2,
                                        from_centre_to_centre(pose1, pose2), of_cores);
  return apart && apart->distance > of_cores;
}

}  // namespace dashpot
