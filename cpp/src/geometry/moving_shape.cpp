#include "moving_shape.hpp"

#include <Eigen/Geometry>
#include <stdexcept>

namespace dashpot {

using Eigen::Vector3d;

namespace {

bool is_revolution(const Shape& shape) {
  return shape.type == ShapeType::kSphere || shape.type == ShapeType::kCapsule ||
         shape.type == ShapeType::kCylinder ||
         (shape.type == ShapeType::kEllipsoid && shape.size[0] == shape.size[1]);
}

}  // namespace

double MovingShape::height(const Vector3d& normal, double sign, double tau) const {
  const double along = normal.dot(motion.linear);
  if (shape.type == ShapeType::kPlane) return normal.dot(pose.position) + tau * along;
  const Vector3d turn = normal.cross(motion.angular);
  const Vector3d tilted = normal + tau * turn;
  const double curvature = motion.angular.norm() * turn.norm() * axis_radius;
  return core_support(shape, pose, sign * tilted).dot(tilted) +
         tau * (along - motion.centre.dot(turn)) +
         sign * (0.5 * curvature * tau * tau + sweep_radius(shape));
}

double MovingShape::turning_height(const Vector3d& normal, const Vector3d& rate, double sign,
                                   double tau) const {
  const Vector3d relative = rate - motion.angular;
  const Vector3d tilted = normal + tau * relative.cross(normal);
  const double curvature = relative.norm() * (motion.angular.norm() + rate.norm()) * centre_radius;
  return (core_support(shape, pose, sign * tilted) - motion.centre).dot(tilted) +
         sign * (0.5 * curvature * tau * tau + sweep_radius(shape));
}

MovingShape make_moving(const Shape& shape, const Pose& pose, const Motion& motion) {
  MovingShape moving{shape, motion, pose};
  if (shape.type != ShapeType::kPlane)
    moving.centre_radius = (pose.position - motion.centre).norm() + core_extent(shape);
  if (motion.angular.isZero(0.0)) return moving;
  if (shape.type == ShapeType::kPlane)
    throw std::invalid_argument("time of impact with a plane that turns is not defined");
  const Vector3d axis = motion.angular.normalized();
  moving.axis_radius = core_axis_radius(shape, pose, motion.centre, axis);
  const bool at_centre = (pose.position - motion.centre).cross(axis).isZero(0.0);
  const bool on_axis = pose.rotation.col(2).cross(axis).isZero(0.0);
  if (at_centre && is_revolution(shape) && (on_axis || shape.type == ShapeType::kSphere)) {
    moving.motion.angular.setZero();  // spins in place
    moving.axis_radius = 0.0;
  }
  return moving;
}

}  // namespace dashpot
