#include "geom_on_terrain.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/geometry_host.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Angle (rad) up to which a face or a side lies flat on a triangle.
constexpr double kFlatOn = 0.02;

bool lies_on_side(const mjModel* m, int geom, const Pose& pose, const Vector3d& up) {
  const int type = m->geom_type[geom];
  return type == mjGEOM_CAPSULE ||
         (type == mjGEOM_CYLINDER && std::abs(pose.rotation.col(2).dot(up)) < std::cos(kMostTilt));
}

}  // namespace

RoundSurfaces::RoundSurfaces(const mjModel_* m, int geom) {
  const mjtNum* const size = m->geom_size + 3 * geom;
  half_ = Vector3d::Constant(size[0]);
  switch (m->geom_type[geom]) {
    case mjGEOM_CAPSULE:
      half_length_ = size[1];
      count_ = 2;
      break;
    case mjGEOM_ELLIPSOID:
      half_ = Vector3d(size[0], size[1], size[2]);
      [[fallthrough]];
    case mjGEOM_SPHERE:
      count_ = 1;
      break;
    default:
      break;
  }
}

Vector3d RoundSurfaces::lowest_along(const Vector3d& normal, int surface, const Pose& pose) const {
  const double along = surface == 0 ? -half_length_ : half_length_;
  const Vector3d centre = pose.position + along * pose.rotation.col(2);
  if (half_.x() == half_.y() && half_.y() == half_.z()) return centre - half_.x() * normal;
  const Vector3d scaled = half_.cwiseProduct(pose.rotation.transpose() * normal);
  return centre - pose.rotation * half_.cwiseProduct(scaled.normalized());
}

GeomOnTerrain::GeomOnTerrain(const mjModel* m, const mjData* d, int terrain_id, int geom_id,
                             double within, FaceBuffers& face_buffers)
    : model(m),
      id(geom_id),
      margin(within),
      radius(m->geom_rbound[id]),
      buffers(face_buffers),
      field(height_field(m, m->geom_dataid[terrain_id])),
      terrain(field),
      round(m, id),
      frame(unchecked_geom_pose(d, terrain_id)),
      pose(relative_pose(frame, unchecked_geom_pose(d, id))),
      up(terrain.normal_beneath(pose.position)),
      on_side(lies_on_side(m, id, pose, up)) {}

double GeomOnTerrain::inward_way(const Vector3d& point) const {
  return std::min({field.half_x - std::abs(point.x()), field.half_y - std::abs(point.y()),
                   point.z() + field.base});
}

bool GeomOnTerrain::has_flat_edge(const TerrainTriangle& triangle) const {
  for (int edge = 0; edge < 3; ++edge)
    if (std::abs(terrain.bend(triangle, edge)) <= kFlatBend) return true;
  return false;
}

std::optional<PlacedFace> GeomOnTerrain::turned_to(const TerrainTriangle& triangle) const {
  const Vector3d& outward = triangle.normal;
  const Vector3d local = (pose.rotation.transpose() * outward).cwiseAbs();
  const mjtNum* const size = model->geom_size + 3 * id;
  const double standing = std::cos(kFlatOn), lying = std::sin(kFlatOn);
  const int type = model->geom_type[id];
  switch (type) {
    case mjGEOM_BOX:
      if (local.maxCoeff() < standing) break;
      return place_box_face(Vector3d(size[0], size[1], size[2]), pose, -outward);
    case mjGEOM_CYLINDER:
      if (local.z() > standing) return place_cap(size[0], size[1], pose, -outward, outward);
      [[fallthrough]];
    case mjGEOM_CAPSULE:
      if (local.z() > lying || !has_flat_edge(triangle)) break;
      return place_side(size[0], size[1], type == mjGEOM_CAPSULE, pose, outward);
    case mjGEOM_MESH:
      return flat_face_along(model, id, pose, -outward, kFlatOn, buffers);
    default:
      break;
  }
  return std::nullopt;
}

FaceManifold GeomOnTerrain::shared_with(const TerrainTriangle& triangle) const {
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
  return meet_face(top, *turned, margin);
}

}  // namespace dashpot::host
