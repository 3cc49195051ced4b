#include "dashpot/geometry/shape.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace dashpot {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

Vector3d local_support(const Shape& shape, const Vector3d& d) {
  const Vector3d& size = shape.size;
  switch (shape.type) {
    case ShapeType::kSphere:
      return Vector3d::Zero();
    case ShapeType::kCapsule:
      return {0.0, 0.0, d.z() < 0.0 ? -size[1] : size[1]};
    case ShapeType::kCylinder: {
      const double radial = std::hypot(d.x(), d.y());
      const double scale = radial > 0.0 ? size[0] / radial : 0.0;
      return {scale * d.x(), scale * d.y(), d.z() < 0.0 ? -size[1] : size[1]};
    }
    case ShapeType::kEllipsoid: {
      const Vector3d scaled = size.cwiseProduct(d);
      return size.cwiseProduct(scaled) / scaled.norm();
    }
    case ShapeType::kBox:
      return {d.x() < 0.0 ? -size[0] : size[0], d.y() < 0.0 ? -size[1] : size[1],
              d.z() < 0.0 ? -size[2] : size[2]};
    case ShapeType::kHull:
      return shape.hull->furthest_along(d);
    case ShapeType::kPlane:
    case ShapeType::kHeightField:
      break;
  }
  throw std::logic_error("planes and height fields have no support point");
}

// Distance of the furthest of `count` points from a line.
template <typename PointAt>
double furthest_from_line(int count, const PointAt& point, const Vector3d& centre,
                          const Vector3d& axis) {
  double furthest = 0.0;
  for (int i = 0; i < count; ++i)
    furthest = std::max(furthest, (point(i) - centre).cross(axis).norm());
  return furthest;
}

}  // namespace

Pose relative_pose(const Pose& frame, const Pose& pose) {
  return {frame.rotation.transpose() * (pose.position - frame.position),
          frame.rotation.transpose() * pose.rotation};
}

Pose advance(const Pose& pose, const Motion& motion, double time) {
  const double angle = motion.angular.norm() * time;
  const Matrix3d turn =
      angle == 0.0 ? Matrix3d::Identity()
                   : Eigen::AngleAxisd(angle, motion.angular.normalized()).toRotationMatrix();
  return {motion.centre + motion.way(time) + turn * (pose.position - motion.centre),
          turn * pose.rotation};
}

bool has_core(const Shape& shape) {
  return shape.type != ShapeType::kPlane && shape.type != ShapeType::kHeightField;
}

double sweep_radius(const Shape& shape) {
  return shape.type == ShapeType::kSphere || shape.type == ShapeType::kCapsule ? shape.size[0]
                                                                               : 0.0;
}

Vector3d core_support(const Shape& shape, const Pose& pose, const Vector3d& direction) {
  return pose.position +
         pose.rotation * local_support(shape, pose.rotation.transpose() * direction);
}

double core_extent(const Shape& shape) {
  const Vector3d& size = shape.size;
  switch (shape.type) {
    case ShapeType::kSphere:
      return 0.0;
    case ShapeType::kCapsule:
      return size[1];
    case ShapeType::kCylinder:
      return std::hypot(size[0], size[1]);
    case ShapeType::kEllipsoid:
      return size.maxCoeff();
    case ShapeType::kBox:
      return size.norm();
    case ShapeType::kHull:
      return shape.hull->extent();
    case ShapeType::kPlane:
    case ShapeType::kHeightField:
      break;
  }
  throw std::logic_error("planes and height fields have no core");
}

double core_axis_radius(const Shape& shape, const Pose& pose, const Vector3d& centre,
                        const Vector3d& axis) {
  const auto at = [&](double x, double y, double z) -> Vector3d {
    return pose.position + pose.rotation * Vector3d(x, y, z);
  };
  const Vector3d& size = shape.size;
  switch (shape.type) {
    case ShapeType::kCapsule:
      return furthest_from_line(
          2, [&](int i) { return at(0.0, 0.0, i == 0 ? size[1] : -size[1]); }, centre, axis);
    case ShapeType::kBox:
      return furthest_from_line(
          8,
          [&](int i) {
            return at(i & 1 ? size[0] : -size[0], i & 2 ? size[1] : -size[1],
                      i & 4 ? size[2] : -size[2]);
          },
          centre, axis);
    case ShapeType::kHull:
      return furthest_from_line(
          shape.hull->count(),
          [&](int i) -> Vector3d { return pose.position + pose.rotation * shape.hull->corner(i); },
          centre, axis);
    default:
      return (pose.position - centre).cross(axis).norm() + core_extent(shape);
  }
}

void check_shape(const Shape& shape, const char* label) {
  const auto fail = [&](const std::string& what) {
    throw std::invalid_argument(std::string(label) + ": " + what);
  };
  if (shape.type == ShapeType::kPlane) return;
  if (shape.type == ShapeType::kHull) {
    if (!shape.hull || shape.hull->count() == 0) fail("the mesh has no vertices");
    if (!shape.hull->is_finite()) fail("a mesh vertex is not finite");
    return;
  }
  if (shape.type == ShapeType::kHeightField) {
    const HeightField& field = shape.field;
    if (field.rows < 2 || field.columns < 2) fail("the height field has no cells");
    for (const auto& [name, value] : {std::pair{"half_x", field.half_x},
                                      {"half_y", field.half_y},
                                      {"elevation", field.elevation},
                                      {"base", field.base}})
      if (!(value > 0.0) || !std::isfinite(value))
        fail(std::string(name) + " = " + std::to_string(value) + " must be positive and finite");
    return;
  }
  const int used = shape.type == ShapeType::kSphere                                          ? 1
                   : shape.type == ShapeType::kCapsule || shape.type == ShapeType::kCylinder ? 2
                                                                                             : 3;
  for (int i = 0; i < used; ++i) {
    if (!(shape.size[i] > 0.0) || !std::isfinite(shape.size[i])) {
      fail("size[" + std::to_string(i) + "] = " + std::to_string(shape.size[i]) +
           " must be positive and finite");
    }
  }
}

}  // namespace dashpot
