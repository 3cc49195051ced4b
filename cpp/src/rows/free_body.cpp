#include "dashpot/rows/free_body.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

// Fraction of the gyroscopic torque below which an applied one is rounding error.
constexpr double kNoTorque = 1.0e-14;

// Velocity of the centre of mass, world.
Eigen::Vector3d centre_velocity(const FreeBody& body) {
  const Eigen::Vector3d omega = body.orientation * body.velocity.tail<3>();
  const Eigen::Vector3d arm = body.orientation * body.offset;
  return body.velocity.head<3>() + omega.cross(arm);
}

// Kinetic energy of a rotation, angular velocity in the principal frame.
double rotation_energy(const FreeBody& body, const Eigen::Vector3d& local) {
  return 0.5 * body.inertia.dot(local.cwiseProduct(local));
}

// Of the principal frame.
Rotation rotation_at_start(const FreeMotion& motion) {
  Rotation start;
  start.orientation = motion.start.orientation * motion.start.principal;
  start.angular_momentum =
      momentum_of(start.orientation, motion.start.inertia, motion.angular_velocity);
  return start;
}

}  // namespace

FreeMotion predict_free_motion(const FreeBody& body, double step, bool rough) {
  FreeMotion motion;
  motion.start = body;
  freeze_at(motion, body.orientation);
  const Eigen::Vector3d omega = body.orientation * body.velocity.tail<3>();
  const Eigen::Vector3d alpha = body.orientation * body.acceleration.tail<3>();
  motion.angular_velocity = omega;
  motion.centre_velocity = body.velocity.head<3>() + omega.cross(motion.arm);
  motion.centre_acceleration =
      body.acceleration.head<3>() + alpha.cross(motion.arm) + omega.cross(omega.cross(motion.arm));
  const Rotation start = rotation_at_start(motion);
  const Eigen::Vector3d euler = momentum_of(start.orientation, body.inertia, alpha);
  const Eigen::Vector3d gyroscopic = omega.cross(start.angular_momentum);
  motion.torque = euler + gyroscopic;
  // A free spin is exact and cheaper without the rounding error of the two.
  if (motion.torque.squaredNorm() <= kNoTorque * kNoTorque * gyroscopic.squaredNorm())
    motion.torque.setZero();
  motion.end = rotate_free(start, body.inertia, motion.torque, step, rough);
  return motion;
}

void add_load(FreeMotion& motion, double step, const Vector6& wrench) {
  motion.centre_acceleration += wrench.head<3>() / motion.start.mass;
  motion.torque += wrench.tail<3>();
  motion.end =
      rotate_free(rotation_at_start(motion), motion.start.inertia, motion.torque, step, false);
}

void freeze_at(FreeMotion& motion, const Eigen::Quaterniond& orientation) {
  motion.frame = orientation;
  motion.arm = orientation * motion.start.offset;
}

Vector6 start_velocity(const FreeMotion& motion) {
  Vector6 velocity;
  velocity.head<3>() = motion.centre_velocity - motion.angular_velocity.cross(motion.arm);
  velocity.tail<3>() = motion.frame.conjugate() * motion.angular_velocity;
  return velocity;
}

Vector6 mean_acceleration(const FreeMotion& motion, double step) {
  const FreeBody& body = motion.start;
  const Eigen::Vector3d alpha =
      (angular_velocity(motion.end, body.inertia) - motion.angular_velocity) / step;
  Vector6 acceleration;
  acceleration.head<3>() = motion.centre_acceleration - alpha.cross(motion.arm);
  acceleration.tail<3>() = motion.frame.conjugate() * alpha;
  return acceleration;
}

FreeBody finish_free_motion(const FreeMotion& motion, double step, const Vector6& velocity_change,
                            const Vector6& displacement) {
  const FreeBody& start = motion.start;
  Rotation end = motion.end;
  end.angular_momentum +=
      momentum_of(motion.frame * start.principal, start.inertia, velocity_change.tail<3>());
  end.orientation = (rotation_of(displacement.tail<3>()) * end.orientation).normalized();

  FreeBody body = start;
  body.orientation = (end.orientation * start.principal.conjugate()).normalized();
  const Eigen::Vector3d omega = angular_velocity(end, start.inertia);
  const Eigen::Vector3d arm = body.orientation * start.offset;
  const Eigen::Vector3d centre_displacement = step * motion.centre_velocity +
                                              0.5 * step * step * motion.centre_acceleration +
                                              displacement.head<3>();
  const Eigen::Vector3d centre_velocity =
      motion.centre_velocity + step * motion.centre_acceleration + velocity_change.head<3>();
  body.origin = start.origin + centre_displacement + (start.orientation * start.offset - arm);
  body.velocity.head<3>() = centre_velocity - omega.cross(arm);
  body.velocity.tail<3>() = body.orientation.conjugate() * omega;
  return body;
}

double energy_gain(const FreeMotion& motion, const Vector6& displacement, const FreeBody& end) {
  const FreeBody& start = motion.start;
  const Eigen::Vector3d arm = end.orientation * end.offset;
  const Eigen::Vector3d way = end.origin + arm - start.origin - start.orientation * start.offset;
  const double translation =
      0.5 * start.mass *
          (centre_velocity(end).squaredNorm() - motion.centre_velocity.squaredNorm()) -
      start.mass * motion.centre_acceleration.dot(way);
  // Without contact the smooth torque does the work that the rotation gains.
  const double smooth = rotation_energy(
      start, motion.end.orientation.conjugate() * angular_velocity(motion.end, start.inertia));
  const double rotation =
      rotation_energy(start, start.principal.conjugate() * end.velocity.tail<3>()) - smooth;
  return translation + rotation - motion.torque.dot(displacement.tail<3>());
}

double kinetic_energy(const FreeBody& body) {
  return 0.5 * body.mass * centre_velocity(body).squaredNorm() +
         rotation_energy(body, body.principal.conjugate() * body.velocity.tail<3>());
}

double brake_rotation(FreeBody& body, double energy) {
  const double rotation =
      rotation_energy(body, body.principal.conjugate() * body.velocity.tail<3>());
  if (rotation == 0.0) return 0.0;
  const double loss = 1.0 - std::sqrt(std::max(0.0, 1.0 - energy / rotation));
  // The centre of mass keeps its velocity.
  const Eigen::Vector3d arm = body.orientation * body.offset;
  const Eigen::Vector3d omega = body.orientation * body.velocity.tail<3>();
  body.velocity.head<3>() += loss * omega.cross(arm);
  body.velocity.tail<3>() *= 1.0 - loss;
  return std::min(energy, rotation);
}

double brake_translation(FreeBody& body, const Eigen::Vector3d& change, double energy) {
  const double along = centre_velocity(body).dot(change), square = change.squaredNorm();
  if (along <= 0.0) return 0.0;
  // The part p of the change with m (p v.c - p^2 c.c / 2) = energy, at most to where v.c is 0.
  const double taken = std::min(energy, 0.5 * body.mass * along * along / square);
  const double root = std::sqrt(std::max(0.0, along * along - 2.0 * square * taken / body.mass));
  body.velocity.head<3>() -= (along - root) / square * change;
  return taken;
}

Vector6 without_zeros(const double* coordinates) {
  Vector6 body;
  std::copy_n(coordinates, 3, body.data());
  std::copy_n(coordinates + 4, 3, body.data() + 3);
  return body;
}

Vector6 motion_of_centre(const FreeMotion& motion, const Vector6& generalized) {
  const Eigen::Vector3d angular = motion.frame * generalized.tail<3>();
  Vector6 centre;
  centre.head<3>() = generalized.head<3>() + angular.cross(motion.arm);
  centre.tail<3>() = angular;
  return centre;
}

Vector6 motion_of_origin(const FreeMotion& motion, const Vector6& centre) {
  Vector6 generalized;
  generalized.head<3>() = centre.head<3>() - centre.tail<3>().cross(motion.arm);
  generalized.tail<3>() = motion.frame.conjugate() * centre.tail<3>();
  return generalized;
}

Vector6 generalized_force(const FreeMotion& motion, const Vector6& wrench) {
  Vector6 force;
  force.head<3>() = wrench.head<3>();
  force.tail<3>() =
      motion.frame.conjugate() * (wrench.tail<3>() + motion.arm.cross(wrench.head<3>()));
  return force;
}

Vector6 wrench_of(const FreeMotion& motion, const Vector6& centre_acceleration) {
  Vector6 wrench;
  wrench.head<3>() = motion.start.mass * centre_acceleration.head<3>();
  wrench.tail<3>() = momentum_of(motion.frame * motion.start.principal, motion.start.inertia,
                                 centre_acceleration.tail<3>());
  return wrench;
}

}  // namespace dashpot
