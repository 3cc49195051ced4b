#include "dashpot/free_body.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace dashpot {

namespace {

// Yoshida's sixth-order weights, symmetric about the middle one.
constexpr std::array<double, 7> kYoshida = {0.784513610477560, 0.235573213359357, -1.17767998417887,
                                            1.315186320683906, -1.17767998417887, 0.235573213359357,
                                            0.784513610477560};

// Turn per composed step for which the sixth-order error is at rounding level over long runs.
constexpr double kComposedTurn = 0.05;
// Turn below which one Strang step (error ~ turn^3 / 12) is at rounding level.
constexpr double kStrangTurn = 1.0e-4;

struct SineCosine {
  double sine, cosine;
};

// Most bodies in a pile barely turn: below 1e-3 rad two terms beyond the first are exact to 1e-20.
SineCosine sine_cosine(double angle) {
  const double square = angle * angle;
  if (square > 1.0e-6) return {std::sin(angle), std::cos(angle)};
  return {angle * (1.0 - square / 6.0 * (1.0 - square / 20.0)),
          1.0 - square / 2.0 * (1.0 - square / 12.0)};
}

// Exact flow of L_i^2 / (2 I_i): the body turns about its principal axis i.
void turn_about_axis(Rotation& r, const Eigen::Vector3d& inertia, int axis, double time) {
  const Eigen::Vector3d direction = r.orientation * Eigen::Vector3d::Unit(axis);
  const double half = 0.5 * time * direction.dot(r.angular_momentum) / inertia[axis];
  Eigen::Vector3d imaginary = Eigen::Vector3d::Zero();
  const SineCosine turn = sine_cosine(half);
  imaginary[axis] = turn.sine;
  r.orientation *= Eigen::Quaterniond(turn.cosine, imaginary.x(), imaginary.y(), imaginary.z());
}

void strang(Rotation& r, const Eigen::Vector3d& inertia, const Eigen::Vector3d& torque,
            double time) {
  r.angular_momentum += 0.5 * time * torque;
  turn_about_axis(r, inertia, 0, 0.5 * time);
  turn_about_axis(r, inertia, 1, 0.5 * time);
  turn_about_axis(r, inertia, 2, time);
  turn_about_axis(r, inertia, 1, 0.5 * time);
  turn_about_axis(r, inertia, 0, 0.5 * time);
  r.angular_momentum += 0.5 * time * torque;
}

Eigen::Quaterniond rotation_of(const Eigen::Vector3d& angle) {
  const double norm = angle.norm();
  if (norm == 0.0) return Eigen::Quaterniond::Identity();
  return Eigen::Quaterniond(Eigen::AngleAxisd(norm, angle / norm));
}

// Angular momentum of a world angular velocity at a principal orientation.
Eigen::Vector3d momentum_of(const Eigen::Quaterniond& orientation, const Eigen::Vector3d& inertia,
                            const Eigen::Vector3d& omega) {
  return orientation * inertia.cwiseProduct(orientation.conjugate() * omega);
}

}  // namespace

Eigen::Vector3d angular_velocity(const Rotation& rotation, const Eigen::Vector3d& inertia) {
  const Eigen::Vector3d local = rotation.orientation.conjugate() * rotation.angular_momentum;
  return rotation.orientation * local.cwiseQuotient(inertia);
}

Rotation rotate_free(const Rotation& start, const Eigen::Vector3d& inertia,
                     const Eigen::Vector3d& torque, double time) {
  Rotation r = start;
  if (inertia[0] == inertia[1] && inertia[1] == inertia[2]) {
    const Eigen::Vector3d mean = (start.angular_momentum + 0.5 * time * torque) / inertia[0];
    r.angular_momentum += time * torque;
    r.orientation = rotation_of(time * mean) * start.orientation;
    return r;
  }
  const Eigen::Vector3d end_momentum = start.angular_momentum + time * torque;
  const double turn =
      time * std::max(start.angular_momentum.norm(), end_momentum.norm()) / inertia.minCoeff();
  if (turn < kStrangTurn) {
    strang(r, inertia, torque, time);
  } else {
    const int steps = static_cast<int>(std::ceil(turn / kComposedTurn));
    for (int i = 0; i < steps; ++i)
      for (double weight : kYoshida) strang(r, inertia, torque, weight * time / steps);
  }
  r.orientation.normalize();
  return r;
}

FreeMotion predict_free_motion(const FreeBody& body, double step) {
  FreeMotion motion;
  motion.start = body;
  freeze_at(motion, body.orientation);
  const Eigen::Vector3d omega = body.orientation * body.velocity.tail<3>();
  const Eigen::Vector3d alpha = body.orientation * body.acceleration.tail<3>();
  motion.angular_velocity = omega;
  motion.centre_velocity = body.velocity.head<3>() + omega.cross(motion.arm);
  motion.centre_acceleration =
      body.acceleration.head<3>() + alpha.cross(motion.arm) + omega.cross(omega.cross(motion.arm));
  Rotation start;
  start.orientation = body.orientation * body.principal;
  start.angular_momentum = momentum_of(start.orientation, body.inertia, omega);
  const Eigen::Vector3d torque =
      momentum_of(start.orientation, body.inertia, alpha) + omega.cross(start.angular_momentum);
  motion.end = rotate_free(start, body.inertia, torque, step);
  return motion;
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
  const Eigen::Vector3d omega_change = motion.frame * velocity_change.tail<3>();
  const Eigen::Vector3d turn = motion.frame * displacement.tail<3>();
  Rotation end = motion.end;
  end.angular_momentum += momentum_of(motion.frame * start.principal, start.inertia, omega_change);
  end.orientation = (rotation_of(turn) * end.orientation).normalized();

  FreeBody body = start;
  body.orientation = (end.orientation * start.principal.conjugate()).normalized();
  const Eigen::Vector3d omega = angular_velocity(end, start.inertia);
  const Eigen::Vector3d arm = body.orientation * start.offset;
  const Eigen::Vector3d centre_displacement = step * motion.centre_velocity +
                                              0.5 * step * step * motion.centre_acceleration +
                                              displacement.head<3>() + turn.cross(motion.arm);
  const Eigen::Vector3d centre_velocity =
      motion.centre_velocity + step * motion.centre_acceleration + velocity_change.head<3>() +
      omega_change.cross(motion.arm);
  body.origin = start.origin + centre_displacement + (start.orientation * start.offset - arm);
  body.velocity.head<3>() = centre_velocity - omega.cross(arm);
  body.velocity.tail<3>() = body.orientation.conjugate() * omega;
  return body;
}

}  // namespace dashpot
