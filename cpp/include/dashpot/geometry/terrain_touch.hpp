// The triangles of a terrain that a round surface touches.

#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>

#include "dashpot/geometry/terrain.hpp"

namespace dashpot {

// Triangles that are tried for the lowest point of a round surface.
inline constexpr int kRounds = 3;
// Cosine of the largest bend at which facets stand for a smooth surface.
inline constexpr double kGentleBend = 0.998;

// The triangle over which the lowest point of a convex surface along its normal lies, from that
// beneath the lowest point along `up` on; `point_along(normal)` (frame of the field) gives these
// points. Over an edge that stands out by a gentle bend it is the one of the facets about that is
// least deep, over a sharp one there is none.
template <typename PointAlong>
std::optional<TerrainTriangle> triangle_beneath(const Terrain& terrain,
                                                const PointAlong& point_along,
                                                const Eigen::Vector3d& up) {
  auto triangle = terrain.beneath(point_along(up));
  auto shallowest = triangle;
  double height = -std::numeric_limits<double>::infinity();
  for (int round = 0; triangle && round < kRounds; ++round) {
    const Eigen::Vector3d point = point_along(triangle->normal);
    if (const double own = triangle->height_of(point); own > height) {
      shallowest = triangle;
      height = own;
    }
    const auto beneath = terrain.beneath(point);
    if (beneath && beneath->is_same(*triangle)) return triangle;
    if (beneath && beneath->normal.dot(triangle->normal) < kGentleBend) return std::nullopt;
    triangle = beneath;
  }
  return triangle ? shallowest : std::nullopt;
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
