#include "dashpot/geometry/query.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>

#include "dashpot/fcl/fcl_broadphase.hpp"
#include "height_field.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Relative to the size of the pair: a clearance whose direction the closest points give to 1e-12
// rad; depth up to which cores touch; bounds that meet as well as many nearly equal directions let
// them, and so far apart that rounding has torn the polytope.
constexpr double kClear = 1e-3;
constexpr double kTouching = 1e-12;
constexpr double kProven = 1e-5;
constexpr double kTorn = 1e-3;

// Penetration without a start: the best few of many directions, refined. Near concentric overlap
// all are nearly as short and several are locally shortest, so that the few keep their distance.
Distance search_penetration(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                            const Pose& pose2) {
  constexpr int kDirections = 256;
  constexpr int kRefined = 8;
  constexpr int kFewRounds = 64;
  constexpr double kSpread = 0.9;  // cosine of two: 0.45 rad, twice what directions are apart
  const double golden_angle = M_PI * (3.0 - std::sqrt(5.0));
  std::vector<std::pair<double, Vector3d>> candidates;
  const auto propose = [&](const Vector3d& normal) {
    const auto point = difference_support(shape1, pose1, shape2, pose2, normal);
    candidates.emplace_back(point.difference.dot(normal), normal);
  };
  for (int i = 0; i < kDirections; ++i) {  // Fibonacci sphere
    const double z = 1.0 - (2.0 * i + 1.0) / kDirections;
    const double radial = std::sqrt(1.0 - z * z);
    propose({radial * std::cos(golden_angle * i), radial * std::sin(golden_angle * i), z});
  }
  for (const Pose* pose : {&pose1, &pose2}) {  // flat ends make narrow peaks
    for (int axis = 0; axis < 3; ++axis) {
      propose(pose->rotation.col(axis));
      propose(-pose->rotation.col(axis));
    }
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const auto& a, const auto& b) { return a.first > b.first; });
  Distance best;
  std::array<Vector3d, kRefined> refined;
  int count = 0;
  for (const auto& candidate : candidates) {
    const Vector3d& normal = candidate.second;
    const auto is_near = [&](const Vector3d& other) { return other.dot(normal) > kSpread; };
    if (std::any_of(refined.begin(), refined.begin() + count, is_near)) continue;
    const Distance found = refine_distance(shape1, pose1, shape2, pose2, normal, kFewRounds);
    if (count == 0 || found.distance > best.distance) best = found;
    refined[count++] = normal;
    if (count == kRefined) break;
  }
  return refine_distance(shape1, pose1, shape2, pose2, best.normal);
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
    const Distance refined = refine_distance(shape1, pose1, shape2, pose2, apart->normal);
    // What rounding leaves of overlap looks apart, in a direction that means nothing.
    if (refined.distance > -kTouching * size) return refined;
  }
  if (const auto start = expand_polytope(shape1, pose1, shape2, pose2)) {
    if (start->exact) return start->distance;
    if (start->bound - start->distance.distance <= kTorn * size) {
      const Distance near = refine_distance(shape1, pose1, shape2, pose2, start->distance.normal);
      if (start->bound - near.distance <= kProven * size) return near;
      // Another direction may be shorter by as much.
      const Distance any = search_penetration(shape1, pose1, shape2, pose2);
      return any.distance > near.distance ? any : near;
    }
  }
  return search_penetration(shape1, pose1, shape2, pose2);
}

bool is_height_field(const Shape& shape) { return shape.type == ShapeType::kHeightField; }

Eigen::AlignedBox3d bounding_box(const PlacedShape& placed, double reach) {
  if (!is_height_field(placed.shape))
    return inflated(bounding_box(placed.shape, placed.pose), reach);
  const Eigen::AlignedBox3d local = height_field_box(placed.shape.field);
  const Vector3d half = placed.pose.rotation.cwiseAbs() * (0.5 * local.sizes());
  const Vector3d centre = placed.pose.position + placed.pose.rotation * local.center();
  return inflated({centre - half, centre + half}, reach);
}

}  // namespace

Distance distance(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2) {
  if (shape1.type == ShapeType::kPlane && shape2.type == ShapeType::kPlane)
    throw std::invalid_argument("two planes have no finite distance");
  if (is_height_field(shape1) && is_height_field(shape2))
    throw std::invalid_argument("two height fields: queries do not cover this pair");
  if (is_height_field(shape2)) return swapped(distance(shape2, pose2, shape1, pose1));
  if (is_height_field(shape1) && shape2.type == ShapeType::kPlane)
    return distance(height_field_hull(shape1.field), pose1, shape2, pose2);
  if (is_height_field(shape1)) return height_field_distance(shape1.field, pose1, shape2, pose2);
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

std::vector<ClosePair> closest_pairs(const std::vector<PlacedShape>& shapes, double radius) {
  std::vector<int> planes, bounded;
  std::vector<Eigen::AlignedBox3d> boxes;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    if (shapes[i].shape.type == ShapeType::kPlane) {
      planes.push_back(static_cast<int>(i));
    } else {
      bounded.push_back(static_cast<int>(i));
      boxes.push_back(bounding_box(shapes[i], 0.5 * radius));
    }
  }

  std::vector<ClosePair> close;
  const auto consider = [&](int first, int second) {
    const PlacedShape& a = shapes[std::min(first, second)];
    const PlacedShape& b = shapes[std::max(first, second)];
    if (a.group == b.group || !(a.of_interest || b.of_interest)) return;
    if (is_height_field(a.shape) && is_height_field(b.shape)) return;
    const Distance found = distance(a.shape, a.pose, b.shape, b.pose);
    if (found.distance <= radius) close.push_back({a.geom, b.geom, found});
  };
  for (const int plane : planes)
    for (const int other : bounded) consider(plane, other);
  for (const auto& [i, j] : overlapping_pairs(boxes)) consider(bounded[i], bounded[j]);
  std::sort(close.begin(), close.end(), [](const ClosePair& a, const ClosePair& b) {
    return std::tie(a.distance.distance, a.geom1, a.geom2) <
           std::tie(b.distance.distance, b.geom1, b.geom2);
  });
  return close;
}

}  // namespace dashpot
