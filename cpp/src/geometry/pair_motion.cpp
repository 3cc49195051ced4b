#include "dashpot/geometry/pair_motion.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr double kStandoff = 0.01;  // of the half-width
// Below this turn (rad) in a part an arm's circle departs from its tangent by less than rounding of
// the standoff, and the axis of the turn may be far away.
constexpr double kSmallTurn = 1e-3;

Vector3d mean_velocity(const SideMotion& s, double length) {
  return s.velocity.linear + 0.5 * length * s.acceleration.linear;
}

}  // namespace

Vector3d SideMotion::turn(double length) const {
  return velocity.angular + 0.5 * length * acceleration.angular;
}

Vector3d SideMotion::shape_turn(double length) const {
  return turn(length) - symmetry * symmetry.dot(turn(length));
}

double SideMotion::turning_speed(double length) const {
  return turn(length).norm() * offset + shape_turn(length).norm() * core_radius;
}

Motion SideMotion::mean_motion(double length) const {
  Motion motion = velocity;
  motion.linear += 0.5 * length * acceleration.linear;
  motion.angular += 0.5 * length * acceleration.angular;
  const double rate = motion.angular.norm();
  if (is_free || rate * length < kSmallTurn) return motion;
  const Vector3d axis = motion.angular / rate;
  motion.centre += axis.cross(motion.linear) / rate;
  motion.linear = axis * axis.dot(motion.linear);
  return motion;
}

double PairMotion::closing_speed(const Vector3d& normal, double length) const {
  double speed = std::max(-normal.dot(relative_velocity(length)), 0.0);
  for (const SideMotion& s : side)
    speed += normal.cross(s.turn(length)).norm() * s.offset +
             normal.cross(s.shape_turn(length)).norm() * s.core_radius;
  return speed;
}

double PairMotion::closing_speed(double length) const {
  double speed = relative_velocity(length).norm();
  for (const SideMotion& s : side) speed += s.turning_speed(length);
  return speed;
}

double PairMotion::turn_rate(double speed, const Vector3d& normal, double length) const {
  double rate = normal.cross(relative_velocity(length)).norm() /
                (side[0].curvature_radius + side[1].curvature_radius);
  for (const SideMotion& s : side) {
    const double reach = s.offset + s.core_radius;
    if (reach == 0.0 || s.tree < 0) continue;
    rate = std::max(rate, (s.turning_speed(length) + speed) / reach);
  }
  return rate;
}

bool PairMotion::is_fast(double speed, const Vector3d& normal, double length, double step) const {
  return speed * step > kFastMotion * half_width ||
         turn_rate(speed, normal, length) * step > kFastTurn;
}

double PairMotion::standoff(double length) const {
  double acceleration = (side[1].acceleration.linear - side[0].acceleration.linear).norm();
  for (const SideMotion& s : side)
    acceleration += s.acceleration.angular.norm() * (s.offset + s.core_radius);
  return kStandoff * half_width + acceleration * length * length / 8.0;
}

Vector3d PairMotion::relative_velocity(double length) const {
  return mean_velocity(side[1], length) - mean_velocity(side[0], length);
}

}  // namespace dashpot
