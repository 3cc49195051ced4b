#include "dashpot/geometry/closest.hpp"

#include <algorithm>
#include <cstddef>
#include <tuple>

#include "dashpot/fcl/fcl_broadphase.hpp"
#include "dashpot/geometry/query.hpp"
#include "height_field.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

Eigen::AlignedBox3d bounding_box(const PlacedShape& placed, double reach) {
  if (placed.shape.type != ShapeType::kHeightField)
    return inflated(bounding_box(placed.shape, placed.pose), reach);
  const Eigen::AlignedBox3d local = height_field_box(placed.shape.field);
  const Vector3d half = placed.pose.rotation.cwiseAbs() * (0.5 * local.sizes());
  const Vector3d centre = placed.pose.position + placed.pose.rotation * local.center();
  return inflated({centre - half, centre + half}, reach);
}

bool is_field(const PlacedShape& placed) { return placed.shape.type == ShapeType::kHeightField; }

}  // namespace

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
    if (is_field(a) && is_field(b)) return;
    const Distance found = distance(a.shape, a.pose, b.shape, b.pose);
    if (found.distance <= radius) close.push_back({a.geom, b.geom, found});
  };
  for (const int plane : planes) {
    for (const int other : bounded) consider(plane, other);
  }
  for (const auto& [i, j] : overlapping_pairs(boxes)) consider(bounded[i], bounded[j]);
  std::sort(close.begin(), close.end(), [](const ClosePair& a, const ClosePair& b) {
    return std::tie(a.distance.distance, a.geom1, a.geom2) <
           std::tie(b.distance.distance, b.geom1, b.geom2);
  });
  return close;
}

}  // namespace dashpot
