#include "terrain.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/terrain_contacts.hpp"
#include "geom_on_terrain.hpp"
#include "moved_geom.hpp"
#include "terrain_points.hpp"

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
