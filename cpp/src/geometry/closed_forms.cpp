// Signed distances between cores that have a short closed form.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dashpot/geometry/convex_distance.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Sine of the angle of two axes up to which they are parallel: their distance changes by no more
// than this along them, relative to their length.
constexpr double kParallel = 1e-10;
// Distance of two axes, relative to the size of the pair, up to which they meet: what rounding
// leaves of the difference of two points, so that its direction means nothing.
constexpr double kMeeting = 1e-15;
// The same of axes that cross, up to which the direction square to both stands for that of the
// difference: it gives away no more than this, and the other one is only good to 1e-16 / 1e-8
// there. Up to the sine of their angle, where that is less: then rounding takes more from it.
constexpr double kCrossing = 1e-8;

Distance plane_distance(const Pose& plane, const Shape& shape, const Pose& pose) {
  Distance result;
  result.normal = plane.rotation.col(2);
  result.point2 = core_support(shape, pose, -result.normal);
  result.distance = result.normal.dot(result.point2 - plane.position);
  result.point1 = result.point2 - result.distance * result.normal;
  return result;
}

bool is_line(const Shape& shape) {
  return shape.type == ShapeType::kSphere || shape.type == ShapeType::kCapsule;
}

double half_length(const Shape& shape) {
  return shape.type == ShapeType::kCapsule ? shape.size[1] : 0.0;
}

// Positions s on line 1 and t on line 2 (unit axes a1, a2, centres apart by r = centre1 - centre2)
// of the closest points of two segments of half-lengths h1 and h2.
void closest_on_segments(const Vector3d& r, const Vector3d& a1, double h1, const Vector3d& a2,
                         double h2, double& s, double& t) {
  const double b = a1.dot(a2), c = a1.dot(r), f = a2.dot(r);
  const double sine2 = a1.cross(a2).squaredNorm();
  if (sine2 > kParallel * kParallel) {
    s = std::clamp((b * f - c) / sine2, -h1, h1);
  } else {  // parallel: the middle of the stretch where they face each other
    const double centre = -c;
    const double low = std::max(-h1, centre - h2), high = std::min(h1, centre + h2);
    s = std::clamp(0.5 * (low + high), -h1, h1);
  }
  t = std::clamp(b * s + f, -h2, h2);
  s = std::clamp(b * t - c, -h1, h1);
}

Distance line_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                       const Pose& pose2) {
  const Vector3d a1 = pose1.rotation.col(2), a2 = pose2.rotation.col(2);
  const double h1 = half_length(shape1), h2 = half_length(shape2);
  double s = 0.0, t = 0.0;
  closest_on_segments(pose1.position - pose2.position, a1, h1, a2, h2, s, t);
  Distance result;
  result.point1 = pose1.position + s * a1;
  result.point2 = pose2.position + t * a2;
  const Vector3d apart = result.point2 - result.point1;
  result.distance = apart.norm();
  const double size = h1 + h2 + (pose2.position - pose1.position).norm();
  const Vector3d across = a1.cross(a2);
  const double sine = h1 > 0.0 && h2 > 0.0 ? across.norm() : 0.0;
  if (sine > kParallel && result.distance <= std::min(kCrossing, sine) * size)
    result.normal = across / (across.dot(apart) < 0.0 ? -sine : sine);
  else if (result.distance > kMeeting * size)
    result.normal = apart / result.distance;
  else if (h1 > 0.0 || h2 > 0.0)
    result.normal = (h1 > 0.0 ? a1 : a2).unitOrthogonal();
  return result;
}

// Signed distance of a point, in the box's frame, from the box.
Distance box_point(const Vector3d& half, const Vector3d& point) {
  Distance result;
  result.point2 = point;
  result.point1 = point.cwiseMax(-half).cwiseMin(half);
  const Vector3d apart = point - result.point1;
  const double length = apart.norm();
  if (length > 0.0) {
    result.distance = length;
    result.normal = apart / length;
    return result;
  }
  Eigen::Index axis = 0;
  const double depth = (half - point.cwiseAbs()).minCoeff(&axis);
  const double side = point[axis] < 0.0 ? -1.0 : 1.0;
  result.distance = -depth;
  result.normal = side * Vector3d::Unit(axis);
  result.point1[axis] = side * half[axis];
  return result;
}

// Signed distance of a point, in the cylinder's frame, from the cylinder.
Distance cylinder_point(double radius, double half, const Vector3d& point) {
  const double radial = std::hypot(point.x(), point.y());
  const Vector3d outward =
      radial > 0.0 ? Vector3d(point.x() / radial, point.y() / radial, 0.0) : Vector3d::UnitX();
  const double beyond_wall = radial - radius, beyond_cap = std::abs(point.z()) - half;
  const double side = point.z() < 0.0 ? -1.0 : 1.0;
  Distance result;
  result.point2 = point;
  result.point1 = point;
  if (beyond_wall <= 0.0 && beyond_cap <= 0.0) {
    result.distance = std::max(beyond_wall, beyond_cap);
    result.normal = beyond_wall > beyond_cap ? outward : Vector3d(side * Vector3d::UnitZ());
    result.point1 -= result.distance * result.normal;
    return result;
  }
  const Vector3d apart =
      std::max(beyond_wall, 0.0) * outward + std::max(beyond_cap, 0.0) * side * Vector3d::UnitZ();
  result.distance = apart.norm();
  result.normal = apart / result.distance;
  result.point1 -= apart;
  return result;
}

bool has_axis(const Shape& shape) {
  return shape.type == ShapeType::kCapsule || shape.type == ShapeType::kCylinder;
}

// Two cylinders or segments along the same axis, in the frame of the first, `apart` from centre to
// centre. Their difference is a cylinder.
Distance parallel_distance(const Shape& shape1, const Shape& shape2, const Vector3d& apart) {
  const double radius1 = shape1.type == ShapeType::kCylinder ? shape1.size[0] : 0.0;
  const double radius2 = shape2.type == ShapeType::kCylinder ? shape2.size[0] : 0.0;
  const double half1 = shape1.size[1], half2 = shape2.size[1];
  Distance result = cylinder_point(radius1 + radius2, half1 + half2, apart);
  const double radial = std::hypot(apart.x(), apart.y());
  Vector3d outward = Vector3d::UnitX();
  if (radial > 0.0) outward = Vector3d(apart.x() / radial, apart.y() / radial, 0.0);
  // Opposite points of surfaces that face each other; where they pass each other, the middle.
  const auto middle = [](double half_width1, double half_width2, double offset) {
    return 0.5 * (std::max(-half_width1, offset - half_width2) +
                  std::min(half_width1, offset + half_width2));
  };
  const bool walls = result.normal.head<2>().any(), caps = result.normal.z() != 0.0;
  const double across = middle(radius1, radius2, radial);
  const double along = middle(half1, half2, apart.z());
  const double side = apart.z() < 0.0 ? -1.0 : 1.0;
  result.point1 = (walls ? radius1 : across) * outward;
  result.point1.z() = caps ? side * half1 : along;
  result.point2 = (walls ? radial - radius2 : across) * outward;
  result.point2.z() = caps ? apart.z() - side * half2 : along;
  return result;
}

Distance to_world(const Distance& local, const Pose& pose) {
  return {local.distance, pose.position + pose.rotation * local.point1,
          pose.position + pose.rotation * local.point2, pose.rotation * local.normal};
}

// Shape 2 is a point.
std::optional<Distance> point_distance(const Shape& shape, const Pose& pose,
                                       const Vector3d& point) {
  const Vector3d local = pose.rotation.transpose() * (point - pose.position);
  if (shape.type == ShapeType::kBox) return to_world(box_point(shape.size, local), pose);
  if (shape.type == ShapeType::kCylinder)
    return to_world(cylinder_point(shape.size[0], shape.size[1], local), pose);
  return std::nullopt;
}

}  // namespace

std::optional<Distance> closed_form_distance(const Shape& shape1, const Pose& pose1,
                                             const Shape& shape2, const Pose& pose2) {
  if (shape1.type == ShapeType::kPlane) return plane_distance(pose1, shape2, pose2);
  if (shape2.type == ShapeType::kPlane) return swapped(plane_distance(pose2, shape1, pose1));
  if (is_line(shape1) && is_line(shape2)) return line_distance(shape1, pose1, shape2, pose2);
  if (shape2.type == ShapeType::kSphere) return point_distance(shape1, pose1, pose2.position);
  if (shape1.type == ShapeType::kSphere) {
    if (const auto found = point_distance(shape2, pose2, pose1.position)) return swapped(*found);
  }
  if (has_axis(shape1) && has_axis(shape2) &&
      pose1.rotation.col(2).cross(pose2.rotation.col(2)).norm() <= kParallel) {
    const Vector3d apart = pose1.rotation.transpose() * (pose2.position - pose1.position);
    return to_world(parallel_distance(shape1, shape2, apart), pose1);
  }
  return std::nullopt;
}

}  // namespace dashpot
