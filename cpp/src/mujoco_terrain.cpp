#include "dashpot/mujoco_terrain.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "dashpot/face_manifold.hpp"
#include "dashpot/geometry_host.hpp"
#include "dashpot/mujoco_faces.hpp"
#include "dashpot/mujoco_hull_vertices.hpp"
#include "dashpot/mujoco_moved_geom.hpp"
#include "dashpot/mujoco_round_surfaces.hpp"
#include "dashpot/terrain.hpp"
#include "dashpot/terrain_contacts.hpp"
#include "dashpot/terrain_touch.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Angle (rad) up to which a face or a side lies flat on a triangle.
constexpr double kFlatOn = 0.02;
// Parts of the geom's radius: how far from an edge MuJoCo's contacts lie on it, those of round
// geoms too, how near to another contact they are the same, and how near to that of a corner, which
// prisms beside its own give.
constexpr double kOnEdge = 0.01;
constexpr double kRoundOnEdge = 0.001;
constexpr double kSamePlace = 0.01;
constexpr double kSameCorner = 0.1;
// Cosine between the normals of such contacts.
constexpr double kSameNormal = 0.9998;
constexpr double kSameCornerNormal = 0.9;

// The pose of a geom in the frame of another one.
Pose pose_in(const mjData* d, int frame, int geom) {
  const Pose outer = unchecked_geom_pose(d, frame), world = unchecked_geom_pose(d, geom);
  Pose pose;
  pose.position = outer.rotation.transpose() * (world.position - outer.position);
  pose.rotation = outer.rotation.transpose() * world.rotation;
  return pose;
}

static_assert(TerrainContacts::kRoom == mjMAXCONPAIR);

// Finds the contacts of one geom with one height field, in its frame.
class TerrainCollision {
 public:
  TerrainCollision(const mjModel* m, const mjData* d, int terrain, int geom, double margin,
                   FaceBuffers& buffers)
      : m_(m),
        geom_(geom),
        margin_(margin),
        buffers_(buffers),
        field_(height_field(m, m->geom_dataid[terrain])),
        terrain_(field_),
        round_(m, geom),
        frame_(unchecked_geom_pose(d, terrain)),
        pose_(pose_in(d, terrain, geom)),
        found_(m->geom_rbound[geom]) {}

  // Contacts of the geom's own points.
  void find() {
    const auto beneath = terrain_.beneath(pose_.position);
    const Vector3d up = beneath ? beneath->normal : Vector3d::UnitZ();
    const mjtNum* const size = m_->geom_size + 3 * geom_;
    const int type = m_->geom_type[geom_];
    on_side_ =
        type == mjGEOM_CAPSULE ||
        (type == mjGEOM_CYLINDER && std::abs(pose_.rotation.col(2).dot(up)) < std::cos(kMostTilt));
    switch (type) {
      case mjGEOM_BOX:
        for (int i = 0; i < 8; ++i)
          add_point(at(i & 1 ? size[0] : -size[0], i & 2 ? size[1] : -size[1],
                       i & 4 ? size[2] : -size[2]));
        break;
      case mjGEOM_CYLINDER:
        if (on_side_) {
          add_corners(place_side(size[0], size[1], false, pose_, up));
          break;
        }
        for (double side : {-1.0, 1.0})
          add_corners(place_cap(size[0], size[1], pose_, side * pose_.rotation.col(2), up));
        break;
      case mjGEOM_MESH:
        if (const auto face = flat_face_along(m_, geom_, pose_, -up, kMostTilt, buffers_);
            face && face->count >= kMostCorners)
          add_corners(*face);
        else
          add_vertices();
        break;
      default:
        for (int i = 0; i < round_.count(); ++i) {
          const auto lowest = round_.lowest(i, pose_);
          if (const auto triangle = triangle_beneath(terrain_, lowest, up))
            for_each_touched(terrain_, *triangle, lowest,
                             [&](const TerrainTriangle& t) { add_round(t, lowest(t.normal), i); });
        }
        break;
    }
  }

  // Those of round surfaces with triangles in which they lie deeper where the geom is in the pose
  // `end` (frame of the field), that of the end of the step. Their planes are no less far than what
  // is found already: triangles that rise from those.
  void find_coming(const Pose& end) {
    const auto beneath = terrain_.beneath(end.position);
    const Vector3d up = beneath ? beneath->normal : Vector3d::UnitZ();
    const double deepest = found_.deepest();
    for (int i = 0; i < round_.count(); ++i) {
      const auto lowest = round_.lowest(i, pose_), lowest_at_end = round_.lowest(i, end);
      const auto triangle = triangle_beneath(terrain_, lowest_at_end, up);
      if (!triangle) continue;
      const auto add_coming = [&](const TerrainTriangle& t) {
        const Vector3d point = lowest(t.normal);
        const double distance = t.height_of(point);
        const double at_end = t.height_of(lowest_at_end(t.normal));
        if (at_end < std::min(0.0, distance) && distance > deepest) add_round(t, point, i);
      };
      for_each_touched(terrain_, *triangle, lowest_at_end, add_coming);
    }
  }

  // Of those of a round surface in one place the deepest stays.
  void merge(const Pose& end) { found_.merge(end.position - pose_.position); }

  // Contacts of edges that stand out, about one that MuJoCo finds.
  void find_edges(const mjPreContact& contact) {
    const Vector3d point = on_ground(contact);
    const auto triangle = terrain_.beneath(point);
    if (!triangle) return;
    add_edges(*triangle);
    for (int edge = 0; edge < 3; ++edge) {
      if (triangle->distance_to(edge, point) > kOnEdge * radius()) continue;
      if (const auto beside = terrain_.across(*triangle, edge)) add_edges(*beside);
    }
  }

  // Whether one of MuJoCo's is a contact beside those.
  bool is_another(const mjPreContact& contact) const {
    const Vector3d normal = frame_.rotation.transpose() * Vector3d(contact.normal);
    const double place = (on_side_ ? kSamePlace : kSameCorner) * radius();
    const double cosine = on_side_ ? kSameNormal : kSameCornerNormal;
    if (found_.has(to_local(Vector3d(contact.pos)), normal, contact.dist, place, cosine))
      return false;
    const Vector3d point = on_ground(contact);
    const auto triangle = terrain_.beneath(point);
    if (!triangle || found_.count() == 0) return true;
    const double near = kOnEdge * radius();
    // On the rim or the base; where a round geom lies deep, also on sides that prisms share.
    if (std::abs(triangle->height_of(point)) > near)
      return !has_round_surfaces() || inward_way(point) < near;
    if (shared_with(*triangle).count > 0) return false;
    if (has_round_surfaces() &&
        !terrain_.leads_out(*triangle, point, normal, kRoundOnEdge * radius()))
      return false;
    return !is_on_edge(*triangle, point) || !terrain_.is_flat_about(*triangle, point, near);
  }

  int copy(mjPreContact* contact) const {
    for (const TerrainContact& found : found_) {
      const Vector3d position = frame_.position + frame_.rotation * found.position;
      const Vector3d normal = frame_.rotation * found.normal;
      contact->dist = found.distance;
      mju_copy3(contact->pos, position.data());
      mju_copy3(contact->normal, normal.data());
      mju_zero3(contact->tangent);
      ++contact;
    }
    return found_.count();
  }

  double radius() const { return m_->geom_rbound[geom_]; }
  bool has_round_surfaces() const { return round_.count() > 0; }

 private:
  Vector3d to_local(const Vector3d& point) const {
    return frame_.rotation.transpose() * (point - frame_.position);
  }
  Vector3d at(double x, double y, double z) const {
    return pose_.position + pose_.rotation * Vector3d(x, y, z);
  }

  // The point on the ground of a contact that MuJoCo finds.
  Vector3d on_ground(const mjPreContact& contact) const {
    return to_local(Vector3d(contact.pos) - 0.5 * contact.dist * Vector3d(contact.normal));
  }

  // From the rim or the base of the field to a point inside.
  double inward_way(const Vector3d& point) const {
    return std::min({field_.half_x - std::abs(point.x()), field_.half_y - std::abs(point.y()),
                     point.z() + field_.base});
  }

  // Out of the ground through its top, unless the way through its rim or its base is shorter.
  void add(const TerrainTriangle& triangle, const Vector3d& point, int surface = -1) {
    const double distance = triangle.height_of(point);
    if (!(distance <= margin_) || -distance > inward_way(point))
      return;  // nor where heights are not finite
    if (on_side_ && !has_flat_edge(triangle) && !turned_to(triangle)) return;
    found_.add({point - 0.5 * distance * triangle.normal, triangle.normal, distance, surface});
  }

  // Halves of a cell may have one plane.
  void add_round(const TerrainTriangle& triangle, const Vector3d& point, int surface) {
    if (!found_.has_on_plane(triangle, point)) add(triangle, point, surface);
  }

  // A corner, over the triangle beneath it, and over one beside that rises where the corner comes
  // to it from here.
  void add_point(const Vector3d& point) {
    const auto triangle = terrain_.beneath(point);
    if (!triangle) return;
    add(*triangle, point);
    for (int edge = 0; edge < 3; ++edge) {
      if (terrain_.bend(*triangle, edge) <= kFlatBend) continue;
      const auto beside = terrain_.across(*triangle, edge);
      const Vector3d foot = point - beside->height_of(point) * beside->normal;
      const auto beneath = terrain_.beneath(foot);
      if (beneath && (beneath->is_same(*beside) || beneath->is_same(*triangle)))
        add(*beside, point);
    }
  }

  void add_corners(const PlacedFace& face) {
    for (int i = 0; i < face.count; ++i) add_point(face.corner[i]);
  }

  // What a face or a side that lies flat on a triangle shares with it.
  FaceManifold shared_with(const TerrainTriangle& triangle) const {
    const std::optional<PlacedFace> turned = turned_to(triangle);
    if (!turned) return {};
    PlacedFace top;
    top.normal = triangle.normal;
    top.origin = triangle.corner[0];
    const bool clockwise = triangle.half == 0;  // seen from above
    top.corner[0] = triangle.corner[0];
    top.corner[1] = triangle.corner[clockwise ? 2 : 1];
    top.corner[2] = triangle.corner[clockwise ? 1 : 2];
    top.count = 3;
    return meet_face(top, *turned, margin_);
  }

  // There it touches edges of it that stand out along lines, with both ends.
  void add_edges(const TerrainTriangle& triangle) {
    bool stands_out = false;
    for (int edge = 0; edge < 3; ++edge)
      stands_out = stands_out || terrain_.bend(triangle, edge) < -kFlatBend;
    if (!stands_out) return;
    const FaceManifold shared = shared_with(triangle);
    for (int i = 0; i < shared.count; ++i) {
      const Vector3d& point = shared.point[i].position;
      const Vector3d foot = point - triangle.height_of(point) * triangle.normal;
      const double distance = shared.point[i].distance;
      const double place = (on_side_ ? kSamePlace : kSameCorner) * radius();
      if (is_on_edge(triangle, foot) &&
          !found_.has(point, triangle.normal, distance, place, kSameCornerNormal) &&
          !terrain_.is_flat_about(triangle, foot, kOnEdge * radius()))
        found_.add({point, triangle.normal, distance, -1});
    }
  }

  // Vertices of the hull that are no higher than the highest ground about, and the margin.
  void add_vertices() {
    const HullVertices hull(m_, m_->geom_dataid[geom_]);
    const double highest = terrain_.highest_about(pose_.position, radius()) + margin_;
    const Vector3d down = pose_.rotation.row(2);
    for (int i = 0; i < hull.count(); ++i) {
      const Vector3d vertex = hull.at(i);
      if (pose_.position.z() + down.dot(vertex) <= highest)
        add_point(pose_.position + pose_.rotation * vertex);
    }
  }

  // Whether a triangle is part of a larger flat one.
  bool has_flat_edge(const TerrainTriangle& triangle) const {
    for (int edge = 0; edge < 3; ++edge)
      if (std::abs(terrain_.bend(triangle, edge)) <= kFlatBend) return true;
    return false;
  }

  bool is_on_edge(const TerrainTriangle& triangle, const Vector3d& point) const {
    for (int edge = 0; edge < 3; ++edge)
      if (triangle.distance_to(edge, point) < kOnEdge * radius()) return true;
    return false;
  }

  // The face, or the line of a side, that lies flat on a triangle.
  std::optional<PlacedFace> turned_to(const TerrainTriangle& triangle) const {
    const Vector3d& up = triangle.normal;
    const Vector3d local = (pose_.rotation.transpose() * up).cwiseAbs();
    const mjtNum* const size = m_->geom_size + 3 * geom_;
    const double standing = std::cos(kFlatOn), lying = std::sin(kFlatOn);
    const int type = m_->geom_type[geom_];
    switch (type) {
      case mjGEOM_BOX:
        if (local.maxCoeff() < standing) break;
        return place_box_face(Vector3d(size[0], size[1], size[2]), pose_, -up);
      case mjGEOM_CYLINDER:
        if (local.z() > standing) return place_cap(size[0], size[1], pose_, -up, up);
        [[fallthrough]];
      case mjGEOM_CAPSULE:
        if (local.z() > lying || !has_flat_edge(triangle)) break;
        return place_side(size[0], size[1], type == mjGEOM_CAPSULE, pose_, up);
      case mjGEOM_MESH:
        return flat_face_along(m_, geom_, pose_, -up, kFlatOn, buffers_);
      default:
        break;
    }
    return std::nullopt;
  }

  const mjModel* m_;
  int geom_;
  double margin_;
  FaceBuffers& buffers_;
  HeightField field_;
  Terrain terrain_;
  RoundSurfaces round_;
  Pose frame_, pose_;  // of the field in the world, of the geom in the field
  TerrainContacts found_;
  // It touches with a round side: on surfaces that bend everywhere what MuJoCo finds of that is
  // right. The rest is corners, and an ellipsoid's lowest point, which are right on every triangle.
  bool on_side_ = false;
};

}  // namespace

bool has_points_on_terrain(int type) {
  return type == mjGEOM_SPHERE || type == mjGEOM_CAPSULE || type == mjGEOM_ELLIPSOID ||
         type == mjGEOM_CYLINDER || type == mjGEOM_BOX || type == mjGEOM_MESH;
}

int take_points_on_terrain(const mjModel_* m, mjData_* d, int terrain, int geom, double margin,
                           FaceBuffers& buffers, mjPreContact_* contact, int count) {
  if (count == 0) return 0;
  TerrainCollision contacts(m, d, terrain, geom, margin, buffers);
  contacts.find();
  if (contacts.has_round_surfaces()) {
    const MovedGeom moved_terrain(m, d, terrain, m->opt.timestep, Spin::kOfShape,
                                  buffers.body_velocity);
    const MovedGeom moved(m, d, geom, m->opt.timestep, Spin::kOfShape, buffers.body_velocity);
    const Pose end = pose_in(d, terrain, geom);
    contacts.find_coming(end);
    contacts.merge(end);
  }
  for (int i = 0; i < count; ++i) contacts.find_edges(contact[i]);
  std::array<mjPreContact, mjMAXCONPAIR> others;
  int other_count = 0;
  for (int i = 0; i < count; ++i) {
    const auto is_same = [&](const mjPreContact& other) {
      return other.dist < contact[i].dist + kAsDeep * contacts.radius() &&
             mju_dist3(other.pos, contact[i].pos) < kSamePlace * contacts.radius() &&
             mju_dot3(other.normal, contact[i].normal) > kSameNormal;
    };
    if (!contacts.is_another(contact[i]) ||
        std::any_of(others.begin(), others.begin() + other_count, is_same))
      continue;
    others[other_count++] = contact[i];
  }
  const int found = contacts.copy(contact);
  other_count = std::min(other_count, mjMAXCONPAIR - found);
  std::copy_n(others.begin(), other_count, contact + found);
  return found + other_count;
}

}  // namespace dashpot::host
