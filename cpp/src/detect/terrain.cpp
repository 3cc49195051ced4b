#include "terrain.hpp"

#include <mujoco/mujoco.h>

#include <cmath>
#include <limits>

#include "contact_motion.hpp"
#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/terrain.hpp"
#include "geom_on_terrain.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Fractions of the geom's radius: how far from an edge MuJoCo's contacts lie on it, those of round
// geoms too, how near to another contact they are the same, and how near to that of a corner, which
// prisms beside its own give.
constexpr double kOnEdge = 0.01;
constexpr double kRoundOnEdge = 0.001;
constexpr double kSamePlace = 0.01;
constexpr double kSameCorner = 0.1;
// Cosine between the normals of such contacts.
constexpr double kSameNormal = 0.9998;
constexpr double kSameCornerNormal = 0.9;

static_assert(TerrainContacts::kRoom == mjMAXCONPAIR);

// The point on the ground of a contact that MuJoCo finds.
Vector3d on_ground(const GeomOnTerrain& geom, const mjPreContact& contact) {
  return geom.to_local(Vector3d(contact.pos) - 0.5 * contact.dist * Vector3d(contact.normal));
}

bool is_on_edge(const GeomOnTerrain& geom, const TerrainTriangle& triangle, const Vector3d& point) {
  for (int edge = 0; edge < 3; ++edge)
    if (triangle.distance_to(edge, point) < kOnEdge * geom.radius) return true;
  return false;
}

// What lies flat on a triangle touches edges of it that stand out along lines, with both ends.
void add_edges(const GeomOnTerrain& geom, const TerrainTriangle& triangle, TerrainContacts& found) {
  bool stands_out = false;
  for (int edge = 0; edge < 3; ++edge)
    stands_out = stands_out || geom.terrain.bend(triangle, edge) < -kFlatBend;
  if (!stands_out) return;
  const FaceManifold shared = geom.shared_with(triangle);
  for (int i = 0; i < shared.count; ++i) {
    const Vector3d& point = shared.point[i].position;
    const Vector3d foot = point - triangle.height_of(point) * triangle.normal;
    const double distance = shared.point[i].distance;
    const double place = (geom.on_side ? kSamePlace : kSameCorner) * geom.radius;
    if (is_on_edge(geom, triangle, foot) &&
        !found.has(point, triangle.normal, distance, place, kSameCornerNormal) &&
        !geom.terrain.is_flat_about(triangle, foot, kOnEdge * geom.radius))
      found.add({point, triangle.normal, distance, -1});
  }
}

// Contacts of edges that stand out, about one that MuJoCo finds.
void add_edges_about(const GeomOnTerrain& geom, const mjPreContact& contact,
                     TerrainContacts& found) {
  const Vector3d point = on_ground(geom, contact);
  const auto triangle = geom.terrain.beneath(point);
  if (!triangle) return;
  add_edges(geom, *triangle, found);
  for (int edge = 0; edge < 3; ++edge) {
    if (triangle->distance_to(edge, point) > kOnEdge * geom.radius) continue;
    if (const auto beside = geom.terrain.across(*triangle, edge)) add_edges(geom, *beside, found);
  }
}

// Whether one of MuJoCo's is a contact beside those.
bool is_another(const GeomOnTerrain& geom, const TerrainContacts& found,
                const mjPreContact& contact) {
  const Vector3d normal = geom.frame.rotation.transpose() * Vector3d(contact.normal);
  const double place = (geom.on_side ? kSamePlace : kSameCorner) * geom.radius;
  const double cosine = geom.on_side ? kSameNormal : kSameCornerNormal;
  if (found.has(geom.to_local(Vector3d(contact.pos)), normal, contact.dist, place, cosine))
    return false;
  const Vector3d point = on_ground(geom, contact);
  const auto triangle = geom.terrain.beneath(point);
  if (!triangle || found.count() == 0) return true;
  const double near = kOnEdge * geom.radius;
  // On the rim or the base; where a round geom lies deep, also on sides that prisms share.
  if (std::abs(triangle->height_of(point)) > near)
    return !geom.has_round_surfaces() || geom.inward_way(point) < near;
  if (geom.shared_with(*triangle).count > 0) return false;
  if (geom.has_round_surfaces() &&
      !geom.terrain.leads_out(*triangle, point, normal, kRoundOnEdge * geom.radius))
    return false;
  return !is_on_edge(geom, *triangle, point) || !geom.terrain.is_flat_about(*triangle, point, near);
}

int copy_found(const GeomOnTerrain& geom, const TerrainContacts& contacts, mjPreContact* contact) {
  for (const TerrainContact& found : contacts) {
    const Vector3d position = geom.frame.position + geom.frame.rotation * found.position;
    const Vector3d normal = geom.frame.rotation * found.normal;
    contact->dist = found.distance;
    mju_copy3(contact->pos, position.data());
    mju_copy3(contact->normal, normal.data());
    mju_zero3(contact->tangent);
    ++contact;
  }
  return contacts.count();
}

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

// Those of round surfaces with triangles in which they lie deeper where the geom is in the pose
// `end` (frame of the field), that of the end of the step. Their planes are no less far than what
// is found already: triangles that rise from those.
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

}  // namespace

int take_points_on_terrain(const mjModel_* m, mjData_* d, int terrain, int geom, double margin,
                           FaceBuffers& buffers, mjPreContact_* contact, int count) {
  if (count == 0) return 0;
  const GeomOnTerrain on_terrain(m, d, terrain, geom, margin, buffers);
  TerrainContacts found(on_terrain.radius);
  add_own_points(on_terrain, found);
  if (on_terrain.has_round_surfaces()) {
    const MovedGeom moved_terrain(m, d, terrain, m->opt.timestep);
    const MovedGeom moved(m, d, geom, m->opt.timestep);
    const Pose end = relative_pose(unchecked_geom_pose(d, terrain), unchecked_geom_pose(d, geom));
    add_coming_points(on_terrain, end, found);
    found.merge(end.position - on_terrain.pose.position);
  }
  for (int i = 0; i < count; ++i) add_edges_about(on_terrain, contact[i], found);
  std::array<mjPreContact, mjMAXCONPAIR> others;
  int other_count = 0;
  for (int i = 0; i < count; ++i) {
    const auto is_same = [&](const mjPreContact& other) {
      return other.dist < contact[i].dist + kAsDeep * on_terrain.radius &&
             mju_dist3(other.pos, contact[i].pos) < kSamePlace * on_terrain.radius &&
             mju_dot3(other.normal, contact[i].normal) > kSameNormal;
    };
    if (!is_another(on_terrain, found, contact[i]) ||
        std::any_of(others.begin(), others.begin() + other_count, is_same))
      continue;
    others[other_count++] = contact[i];
  }
  const int own_count = copy_found(on_terrain, found, contact);
  other_count = std::min(other_count, mjMAXCONPAIR - own_count);
  std::copy_n(others.begin(), other_count, contact + own_count);
  return own_count + other_count;
}

}  // namespace dashpot::host
