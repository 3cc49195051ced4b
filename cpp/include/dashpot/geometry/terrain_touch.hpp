// The triangles of a terrain that a round surface touches.

#pragma once

#include <Eigen/Core>
#include <optional>

#include "dashpot/geometry/terrain.hpp"

namespace dashpot {

// Triangles that are tried for the lowest point of a round surface.
inline constexpr int kRounds = 3;

// The triangle over which the lowest point of a convex surface along its normal lies, from that
// beneath the lowest point along `up` on; `point_along(normal)` (frame of the field) gives these
// points. Over an edge that stands out there is none.
template <typename PointAlong>
std::optional<TerrainTriangle> triangle_beneath(const Terrain& terrain,
                                                const PointAlong& point_along,
                                                const Eigen::Vector3d& up) {
  auto triangle = terrain.beneath(point_along(up));
  for (int round = 0; triangle && round < kRounds; ++round) {
    const auto beneath = terrain.beneath(point_along(triangle->normal));
    if (beneath && beneath->is_same(*triangle)) return triangle;
    triangle = beneath;
  }
  return std::nullopt;
}

// Visits a triangle, and all about it over which the lowest point along their own normal lies:
// those that rise from it near the edge or the corner between.
template <typename PointAlong, typename Visit>
void for_each_touched(const Terrain& terrain, const TerrainTriangle& triangle,
                      const PointAlong& point_along, const Visit& visit) {
  visit(triangle);
  terrain.for_each_about(triangle, [&](const TerrainTriangle& beside) {
    const Eigen::Vector3d point = point_along(beside.normal);
    const auto beneath = terrain.beneath(point - beside.height_of(point) * beside.normal);
    if (beneath && beneath->is_same(beside)) visit(beside);
  });
}

}  // namespace dashpot
