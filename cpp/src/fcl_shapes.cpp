#include "dashpot/fcl_shapes.hpp"

#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/ellipsoid.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/distance.h>

#include <exception>
#include <memory>
#include <stdexcept>
#include <vector>

namespace dashpot {

using Eigen::Vector3d;

namespace {

std::unique_ptr<fcl::CollisionGeometryd> make_core(const Shape& shape) {
  const Vector3d& size = shape.size;
  switch (shape.type) {
    case ShapeType::kSphere:
      return std::make_unique<fcl::Sphered>(0.0);
    case ShapeType::kCapsule:
      return std::make_unique<fcl::Capsuled>(0.0, 2.0 * size[1]);
    case ShapeType::kCylinder:
      return std::make_unique<fcl::Cylinderd>(size[0], 2.0 * size[1]);
    case ShapeType::kEllipsoid:
      return std::make_unique<fcl::Ellipsoidd>(size);
    case ShapeType::kBox:
      return std::make_unique<fcl::Boxd>(2.0 * size);
    case ShapeType::kHull: {
      // Without faces FCL scans the vertices for support points, which is all that it needs.
      auto vertices = std::make_shared<std::vector<Vector3d>>();
      for (Eigen::Index i = 0; i < shape.vertices->cols(); ++i) {
        vertices->push_back(shape.vertices->col(i));
      }
      return std::make_unique<fcl::Convexd>(vertices, 0, std::make_shared<std::vector<int>>());
    }
    case ShapeType::kPlane:
      break;
  }
  throw std::logic_error("planes are not handed to FCL");
}

fcl::Transform3d make_transform(const Pose& pose) {
  fcl::Transform3d transform = fcl::Transform3d::Identity();
  transform.linear() = pose.rotation;
  transform.translation() = pose.position;
  return transform;
}

}  // namespace

std::optional<Distance> fcl_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                                     const Pose& pose2) {
  const auto core1 = make_core(shape1);
  const auto core2 = make_core(shape2);
  const fcl::DistanceRequestd request(true, true);
  fcl::DistanceResultd found;
  try {
    fcl::distance(core1.get(), make_transform(pose1), core2.get(), make_transform(pose2), request,
                  found);
  } catch (const std::exception&) {
    return std::nullopt;
  }
  Distance result;
  result.distance = found.min_distance;
  result.point1 = found.nearest_points[0];
  result.point2 = found.nearest_points[1];
  const Vector3d apart = result.point2 - result.point1;
  const double length = apart.norm();
  if (!(length > 0.0)) return std::nullopt;
  result.normal = result.distance < 0.0 ? Vector3d(-apart / length) : Vector3d(apart / length);
  return result;
}

}  // namespace dashpot
