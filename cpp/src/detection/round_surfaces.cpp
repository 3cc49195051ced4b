#include "dashpot/detection/round_surfaces.hpp"

#include <mujoco/mujoco.h>

namespace dashpot::host {

using Eigen::Vector3d;

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

}  // namespace dashpot::host
