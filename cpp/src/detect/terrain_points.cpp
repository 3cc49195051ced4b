#include "terrain_points.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <limits>
#include <optional>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/geometry_host.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Triangles that are tried for the lowest point of a round surface.
constexpr int kRounds = 3;
// Cosine of the largest bend at which facets stand for a smooth surface.
constexpr double kGentleBend = 0.998;

// The triangle over which the lowest point of a convex surface along its normal lies, from that
// beneath the lowest point along `up` on; `point_along(normal)` (frame of the field) gives these
// points. Over an edge that stands out by a gentle bend it is the one of the facets about that is
// least deep, over a sharp one there is none.
template <typename PointAlong>
std::optional<TerrainTriangle> triangle_beneath(const Terrain& terrain,
                                                const PointAlong& point_along, const Vector3d& up) {
  auto triangle = terrain.beneath(point_along(up));
  auto shallowest = triangle;
  double height = -std::numeric_limits<double>::infinity();
  for (int round = 0; triangle && round < kRounds; ++round) {
    const Vector3d point = point_along(triangle->normal);
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
    const Vector3d point = point_along(beside.normal);
    const auto beneath = terrain.beneath(point - beside.height_of(point) * beside.normal);
    if (beneath && beneath->is_same(beside)) visit(beside);
  });
}

Vector3d at(const GeomOnTerrain& geom, double x, double y, double z) {
  return geom.pose.position + geom.pose.rotation * Vector3d(x, y, z);
}

// Out of the ground through its top, unless the way through its rim or its base is shorter.
void add(const GeomOnTerrain& geom, const TerrainTriangle& triangle, const Vector3d& point,
         TerrainContacts& found, int surface = -1) {
  const double distance = triangle.height_of(point);
  if (!(distance <= geom.margin) || -distance > geom.inward_way(point))
    return;  // nor where heights are not finite
  if (geom.on_side && !geom.has_flat_edge(triangle) && !geom.turned_to(triangle)) return;
  found.add({point - 0.5 * distance * triangle.normal, triangle.normal, distance, surface});
}

// Halves of a cell may have one plane.
void add_round(const GeomOnTerrain& geom, const TerrainTriangle& triangle, const Vector3d& point,
               int surface, TerrainContacts& found) {
  if (!found.has_on_plane(triangle, point, surface)) add(geom, triangle, point, found, surface);
}

void add_corner(const GeomOnTerrain& geom, const Vector3d& point, TerrainContacts& found) {
  if (const auto triangle = geom.terrain.beneath(point)) add(geom, *triangle, point, found);
}

void add_corners(const GeomOnTerrain& geom, const PlacedFace& face, TerrainContacts& found) {
  for (int i = 0; i < face.count; ++i) add_corner(geom, face.corner[i], found);
}

// Vertices of the hull that are no higher than the highest ground about, and the margin.
void add_vertices(const GeomOnTerrain& geom, TerrainContacts& found) {
  const HullVertices hull(geom.model, geom.model->geom_dataid[geom.id]);
  const double highest = geom.terrain.highest_about(geom.pose.position, geom.radius) + geom.margin;
  const Vector3d down = geom.pose.rotation.row(2);
  for (int i = 0; i < hull.count(); ++i) {
    const Vector3d vertex = hull.at(i);
    if (geom.pose.position.z() + down.dot(vertex) <= highest)
      add_corner(geom, geom.pose.position + geom.pose.rotation * vertex, found);
  }
}

// Both ends of the lowest line of a cylinder's side: in a groove one for each side of that.
void add_side(const GeomOnTerrain& geom, TerrainContacts& found) {
  const mjtNum* const size = geom.model->geom_size + 3 * geom.id;
  for (int end = 0; end < 2; ++end) {
    const auto lowest = [&](const Vector3d& normal) {
      return place_side(size[0], size[1], false, geom.pose, normal).corner[end];
    };
    if (const auto triangle = triangle_beneath(geom.terrain, lowest, geom.up))
      for_each_touched(geom.terrain, *triangle, lowest, [&](const TerrainTriangle& t) {
        add_round(geom, t, lowest(t.normal), end, found);
      });
    else
      add_corner(geom, lowest(geom.up), found);
  }
}

}  // namespace

void add_own_points(const GeomOnTerrain& geom, TerrainContacts& found) {
  const mjtNum* const size = geom.model->geom_size + 3 * geom.id;
  const int type = geom.model->geom_type[geom.id];
  switch (type) {
    case mjGEOM_BOX:
      for (int i = 0; i < 8; ++i)
        add_corner(geom,
                   at(geom, i & 1 ? size[0] : -size[0], i & 2 ? size[1] : -size[1],
                      i & 4 ? size[2] : -size[2]),
                   found);
      break;
    case mjGEOM_CYLINDER:
      if (geom.on_side) {
        add_side(geom, found);
        break;
      }
      for (double side : {-1.0, 1.0})
        add_corners(
            geom, place_cap(size[0], size[1], geom.pose, side * geom.pose.rotation.col(2), geom.up),
            found);
      break;
    case mjGEOM_MESH:
      if (const auto face =
              flat_face_along(geom.model, geom.id, geom.pose, -geom.up, kMostTilt, geom.buffers);
          face && face->count >= kMostCorners)
        add_corners(geom, *face, found);
      else
        add_vertices(geom, found);
      break;
    default:
      for (int i = 0; i < geom.round.count(); ++i) {
        const auto lowest = geom.round.lowest(i, geom.pose);
        if (const auto triangle = triangle_beneath(geom.terrain, lowest, geom.up))
          for_each_touched(geom.terrain, *triangle, lowest, [&](const TerrainTriangle& t) {
            add_round(geom, t, lowest(t.normal), i, found);
          });
      }
      break;
  }
}

void add_coming_points(const GeomOnTerrain& geom, const Pose& end, TerrainContacts& found) {
  const Vector3d up = geom.terrain.normal_beneath(end.position);
  const double deepest = found.deepest();
  for (int i = 0; i < geom.round.count(); ++i) {
    const auto lowest = geom.round.lowest(i, geom.pose), lowest_at_end = geom.round.lowest(i, end);
    const auto triangle = triangle_beneath(geom.terrain, lowest_at_end, up);
    if (!triangle) continue;
    const auto add_coming = [&](const TerrainTriangle& t) {
      const Vector3d point = lowest(t.normal);
      const double distance = t.height_of(point);
      const double at_end = t.height_of(lowest_at_end(t.normal));
      if (at_end < std::min(0.0, distance) && distance > deepest)
        add_round(geom, t, point, i, found);
    };
    for_each_touched(geom.terrain, *triangle, lowest_at_end, add_coming);
  }
}

}  // namespace dashpot::host
