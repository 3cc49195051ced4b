// The triangles of a terrain that a body touches.

#pragma once

#include <Eigen/Core>
#include <optional>

#include "dashpot/terrain.hpp"

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

// Visits a triangle, and those beside it that rise from it where the lowest point along their
// normals lies over them; with `ahead` also where it lies over the first.
template <typename PointAlong, typename Visit>
void for_each_touched(const Terrain& terrain, const TerrainTriangle& triangle,
                      const PointAlong& point_along, bool ahead, const Visit& visit) {
  visit(triangle);
  for (int edge = 0; edge < 3; ++edge) {
    if (terrain.bend(triangle, edge) <= kFlatBend) continue;
    const auto beside = terrain.across(triangle, edge);
    const Eigen::Vector3d point = point_along(beside->normal);
    const Eigen::Vector3d foot = point - beside->height_of(point) * beside->normal;
    const auto beneath = terrain.beneath(foot);
    if (beneath && (beneath->is_same(*beside) || (ahead && beneath->is_same(triangle))))
      visit(*beside);
  }
}

}  // namespace dashpot
