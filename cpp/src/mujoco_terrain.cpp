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
#include "dashpot/terrain.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Angle (rad) up to which a face or a side lies flat on a triangle.
constexpr double kFlatOn = 0.02;
// Parts of the geom's radius: how far from an edge MuJoCo's contacts lie on it, how near to another
// contact they are the same, and how near to that of a corner, which prisms beside its own give.
constexpr double kOnEdge = 0.01;
constexpr double kSamePlace = 0.01;
constexpr double kSameCorner = 0.1;
// Part of the geom's radius by which such a contact may be less deep.
constexpr double kAsDeep = 1e-5;
// Cosine between the normals of such contacts.
constexpr double kSameNormal = 0.9998;
constexpr double kSameCornerNormal = 0.9;
// Triangles that are tried for the lowest point of a round surface.
constexpr int kRounds = 3;

// The contacts of one geom with one height field, in its frame.
class TerrainContacts {
 public:
  TerrainContacts(const mjModel* m, const mjData* d, int terrain, int geom, double margin,
                  FaceBuffers& buffers)
      : m_(m),
        geom_(geom),
        margin_(margin),
        buffers_(buffers),
        field_(height_field(m, m->geom_dataid[terrain])),
        terrain_(field_),
        frame_(unchecked_geom_pose(d, terrain)) {
    const Pose world = unchecked_geom_pose(d, geom);
    pose_.position = to_local(world.position);
    pose_.rotation = frame_.rotation.transpose() * world.rotation;
  }

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
      case mjGEOM_SPHERE:
        add_ball(pose_.position, size[0], up);
        break;
      case mjGEOM_CAPSULE:
        for (double end : {-size[1], size[1]}) add_ball(at(0.0, 0.0, end), size[0], up);
        break;
      case mjGEOM_ELLIPSOID: {
        const Vector3d half(size[0], size[1], size[2]);
        add_round(
            [&](const Vector3d& normal) -> Vector3d {
              const Vector3d scaled = half.cwiseProduct(pose_.rotation.transpose() * normal);
              return pose_.position - pose_.rotation * half.cwiseProduct(scaled.normalized());
            },
            up);
        break;
      }
      case mjGEOM_MESH:
        if (const auto face = flat_face_along(m_, geom_, pose_, -up, kMostTilt, buffers_);
            face && face->count >= kMostCorners)
          add_corners(*face);
        else
          add_vertices();
        break;
      default:
        break;
    }
  }

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
    if (is_known(to_local(Vector3d(contact.pos)), normal, contact.dist, place, cosine))
      return false;
    const Vector3d point = on_ground(contact);
    const auto triangle = terrain_.beneath(point);
    if (!triangle || count_ == 0) return true;
    const double near = kOnEdge * radius();
    if (std::abs(triangle->height_of(point)) > near) return true;  // on the rim, or the base
    if (shared_with(*triangle).count > 0) return false;
    return !is_on_edge(*triangle, point) || !terrain_.is_flat_about(*triangle, point, near);
  }

  int copy(mjPreContact* contact) const {
    for (int i = 0; i < count_; ++i) {
      const Vector3d position = frame_.position + frame_.rotation * found_[i].position;
      const Vector3d normal = frame_.rotation * found_[i].normal;
      contact[i].dist = found_[i].distance;
      mju_copy3(contact[i].pos, position.data());
      mju_copy3(contact[i].normal, normal.data());
      mju_zero3(contact[i].tangent);
    }
    return count_;
  }

  double radius() const { return m_->geom_rbound[geom_]; }

 private:
  struct Found {
    Vector3d position, normal;
    double distance;
  };

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

  // Out of the ground through its top, unless the way through its rim or its base is shorter.
  void add(const TerrainTriangle& triangle, const Vector3d& point) {
    const double distance = triangle.height_of(point);
    const double other_way =
        std::min({field_.half_x - std::abs(point.x()), field_.half_y - std::abs(point.y()),
                  point.z() + field_.base});
    if (!(distance <= margin_) || -distance > other_way)
      return;  // nor where heights are not finite
    if (on_side_ && !has_flat_edge(triangle) && !turned_to(triangle)) return;
    keep({point - 0.5 * distance * triangle.normal, triangle.normal, distance});
  }

  // The nearest, where there is no room for all.
  void keep(const Found& contact) {
    if (count_ < mjMAXCONPAIR) {
      found_[count_++] = contact;
      return;
    }
    Found& farthest =
        *std::max_element(found_.begin(), found_.end(),
                          [](const Found& a, const Found& b) { return a.distance < b.distance; });
    if (contact.distance < farthest.distance) farthest = contact;
  }

  // A point of the geom's surface for every normal of the terrain, near a triangle: where it lies
  // over a triangle beside that rises, and where a corner comes to one from here (`ahead`).
  template <typename PointAlong>
  void add_on(const TerrainTriangle& triangle, const PointAlong& point_along, bool ahead) {
    add(triangle, point_along(triangle.normal));
    for (int edge = 0; edge < 3; ++edge) {
      if (terrain_.bend(triangle, edge) <= kFlatBend) continue;
      const auto beside = terrain_.across(triangle, edge);
      const Vector3d point = point_along(beside->normal);
      const Vector3d foot = point - beside->height_of(point) * beside->normal;
      const auto beneath = terrain_.beneath(foot);
      if (beneath && (beneath->is_same(*beside) || (ahead && beneath->is_same(triangle))))
        add(*beside, point);
    }
  }

  void add_point(const Vector3d& point) {
    if (const auto triangle = terrain_.beneath(point))
      add_on(
          *triangle, [&](const Vector3d&) { return point; }, true);
  }

  void add_corners(const PlacedFace& face) {
    for (int i = 0; i < face.count; ++i) add_point(face.corner[i]);
  }

  void add_ball(const Vector3d& centre, double radius, const Vector3d& up) {
    add_round([&](const Vector3d& normal) -> Vector3d { return centre - radius * normal; }, up);
  }

  // Its lowest point lies over the triangle for which it is the lowest. Over an edge that stands
  // out there is none.
  template <typename PointAlong>
  void add_round(const PointAlong& point_along, const Vector3d& up) {
    auto triangle = terrain_.beneath(point_along(up));
    for (int round = 0; triangle && round < kRounds; ++round) {
      const auto beneath = terrain_.beneath(point_along(triangle->normal));
      if (beneath && beneath->is_same(*triangle)) return add_on(*triangle, point_along, false);
      triangle = beneath;
    }
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
          !is_known(point, triangle.normal, distance, place, kSameCornerNormal) &&
          !terrain_.is_flat_about(triangle, foot, kOnEdge * radius()))
        keep({point, triangle.normal, distance});
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

  // Whether a contact that is as deep stands for one within `place` (m), of normals within
  // `cosine`.
  bool is_known(const Vector3d& point, const Vector3d& normal, double distance, double place,
                double cosine) const {
    return std::any_of(found_.begin(), found_.begin() + count_, [&](const Found& f) {
      return f.distance < distance + kAsDeep * radius() && (f.position - point).norm() < place &&
             f.normal.dot(normal) > cosine;
    });
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
  Pose frame_, pose_;  // of the field in the world, of the geom in the field
  std::array<Found, mjMAXCONPAIR> found_;
  int count_ = 0;
  // It touches with a round side: on surfaces that bend everywhere what MuJoCo finds of that is
  // right. The rest is corners, and an ellipsoid's lowest point, which are right on every triangle.
  bool on_side_ = false;
};

}  // namespace

bool has_points_on_terrain(int type) {
  return type == mjGEOM_SPHERE || type == mjGEOM_CAPSULE || type == mjGEOM_ELLIPSOID ||
         type == mjGEOM_CYLINDER || type == mjGEOM_BOX || type == mjGEOM_MESH;
}

int take_points_on_terrain(const mjModel_* m, const mjData_* d, int terrain, int geom,
                           double margin, FaceBuffers& buffers, mjPreContact_* contact, int count) {
  if (count == 0) return 0;
  TerrainContacts contacts(m, d, terrain, geom, margin, buffers);
  contacts.find();
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
