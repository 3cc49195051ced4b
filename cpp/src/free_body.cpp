#include "dashpot/free_body.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace dashpot {

namespace {

// Weights of Yoshida's compositions of fourth and of sixth order, symmetric about the middle one.
constexpr std::array<double, 3> kFourthOrder = {1.3512071919596578, -1.7024143839193153,
                                                1.3512071919596578};
constexpr std::array<double, 7> kSixthOrder = {
    0.784513610477560, 0.235573213359357, -1.17767998417887, 1.315186320683906,
    -1.17767998417887, 0.235573213359357, 0.784513610477560};

// Turn per composed step for which the sixth-order error is at rounding level over long runs, also
// where the ratio of moments multiplies an error of the momentum: in the spin of a thin rod.
constexpr double kComposedTurn = 0.02;
// The same for a prediction that is taken again before it counts: errors below 1e-6.
constexpr double kPredictedTurn = 0.5;
// Part of the gyroscopic torque below which an applied one is rounding error.
constexpr double kNoTorque = 1.0e-14;
// Turn below which one Strang step (error ~ turn^3 / 12) is at rounding level.
constexpr double kStrangTurn = 1.0e-5;
// The same of the product of the turns of two flows that commute but for it.
constexpr double kCommutingTurns = 1.0e-15;
// The same for one step of fourth order (error ~ turn^5 / 10).
constexpr double kFourthOrderTurn = 2.0e-4;

struct SineCosine {
  double sine, cosine;
};

// Series that are exact to rounding for the small angles of almost every call.
inline SineCosine sine_cosine(double angle) {
  const double square = angle * angle;
  if (square < 1.0e-6)
    return {angle * (1.0 - square / 6.0 * (1.0 - square / 20.0)),
            1.0 - square / 2.0 * (1.0 - square / 12.0)};
  if (square < 2.5e-3)
    return {
        angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))),
        1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)))};
  return {std::sin(angle), std::cos(angle)};
}

// Splitting in the principal frame, with a common part of the inertia taken out:
//
//     H = L^2 / (2 I_m) + sum over the other two axes i of (1 / I_i - 1 / I_m) L_i^2 / 2.
//
// The first term turns the body about its angular momentum and commutes with all others; those
// turn it about principal axes, where two components mix at a time. I_m is one of the two most
// equal moments, so that nothing is left of a body of revolution but its spin, whose flow is exact,
// and a thin rod asks for no more steps than its spin does.
template <int m>
class SplitRotation {
 public:
  SplitRotation(const Rotation& start, const Eigen::Vector3d& inertia,
                const Eigen::Vector3d& torque)
      : orientation_(start.orientation),
        momentum_(start.orientation.conjugate() * start.angular_momentum),
        common_(1.0 / inertia[m]),
        rest_(inertia.cwiseInverse().array() - common_),
        torque_(torque),
        has_torque_(!torque.isZero(0.0)) {}

  void strang(double time) {
    if (has_torque_) momentum_ += orientation_.conjugate() * (0.5 * time * torque_);
    turn<kFirst>(pending_ + 0.5 * time);
    turn<kSecond>(time);
    pending_ = 0.5 * time;
    common_time_ += time;
    if (!has_torque_) return;  // joins the first turn of the next step
    finish();
    momentum_ += orientation_.conjugate() * (0.5 * time * torque_);
  }
  void finish() {
    turn<kFirst>(pending_);
    orientation_ = orientation_ * rotation_of(common_time_ * common_ * momentum_);
    pending_ = common_time_ = 0.0;
  }
  Eigen::Quaterniond orientation() const { return orientation_.normalized(); }

  // Bounds on the angles (rad) in `time` (s) that the splitting errors follow, see rotate_free.
  struct Turns {
    double first, second, common;
  };
  Turns turns(double time) const {
    const double torque = torque_.norm(), largest = momentum_.norm() + time * torque;
    const double common = time * largest * common_;
    const Eigen::Vector3d along = orientation_.conjugate() * torque_;
    // A component changes by turns about the other axis, which mix it with the third, and by the
    // torque along its own, which turns with the body.
    const auto turn = [&](int axis, int other) {
      const double rate = 0.5 * std::abs(rest_[other]) * largest * largest + std::abs(along[axis]) +
                          torque * common;
      return time * std::abs(rest_[axis]) *
             std::min(largest, std::abs(momentum_[axis]) + time * rate);
    };
    return {turn(kFirst, kSecond), turn(kSecond, kFirst), common};
  }

 private:
  static constexpr int kFirst = (m + 1) % 3, kSecond = (m + 2) % 3;

  // Exact flow of c_i L_i^2 / 2: the body turns about its principal axis i.
  template <int i>
  void turn(double time) {
    constexpr int j = (i + 1) % 3, k = (i + 2) % 3;
    const auto [sine, cosine] = sine_cosine(0.5 * time * momentum_[i] * rest_[i]);
    const double whole_sine = 2.0 * sine * cosine, whole_cosine = 1.0 - 2.0 * sine * sine;
    const double along_j = momentum_[j];
    momentum_[j] = whole_cosine * along_j + whole_sine * momentum_[k];
    momentum_[k] = whole_cosine * momentum_[k] - whole_sine * along_j;
    Eigen::Vector4d& q = orientation_.coeffs();  // x, y, z, w
    const Eigen::Vector4d p = q;
    q[i] = cosine * p[i] + sine * p[3];
    q[j] = cosine * p[j] + sine * p[k];
    q[k] = cosine * p[k] - sine * p[j];
    q[3] = cosine * p[3] - sine * p[i];
  }

  Eigen::Quaterniond orientation_;
  Eigen::Vector3d momentum_;  // in the principal frame
  const double common_;       // 1 / I_m
  const Eigen::Vector3d rest_, torque_;
  const bool has_torque_;
  double pending_ = 0.0, common_time_ = 0.0;  // s
};

template <int m>
Eigen::Quaterniond split_rotation(const Rotation& start, const Eigen::Vector3d& inertia,
                                  const Eigen::Vector3d& torque, double time, bool rough) {
  SplitRotation<m> split(start, inertia, torque);
  const auto [first, second, common] = split.turns(time);
  const bool has_torque = !torque.isZero(0.0);
  const double turn = std::max({first, second, has_torque ? common : 0.0});
  const bool commute = !has_torque && first * second * (first + second) < kCommutingTurns;
  if (commute || turn < kStrangTurn) {
    split.strang(time);
  } else if (turn < kFourthOrderTurn) {
    for (double weight : kFourthOrder) split.strang(weight * time);
  } else {
    const int steps = static_cast<int>(std::ceil(turn / (rough ? kPredictedTurn : kComposedTurn)));
    for (int i = 0; i < steps; ++i)
      for (double weight : kSixthOrder) split.strang(weight * time / steps);
  }
  split.finish();
  return split.orientation();
}

// One of the two most equal moments of inertia.
int common_axis(const Eigen::Vector3d& inertia) {
  const auto unequal = [&](int i) {
    return std::abs(1.0 / inertia[i] - 1.0 / inertia[(i + 1) % 3]);
  };
  return unequal(0) <= std::min(unequal(1), unequal(2)) ? 0 : unequal(1) <= unequal(2) ? 1 : 2;
}

// Angular momentum of a world angular velocity at a principal orientation.
Eigen::Vector3d momentum_of(const Eigen::Quaterniond& orientation, const Eigen::Vector3d& inertia,
                            const Eigen::Vector3d& omega) {
  return orientation * inertia.cwiseProduct(orientation.conjugate() * omega);
}

}  // namespace

Eigen::Quaterniond rotation_of(const Eigen::Vector3d& angle) {
  const double norm = angle.norm();
  if (norm == 0.0) return Eigen::Quaterniond::Identity();
  const auto [sine, cosine] = sine_cosine(0.5 * norm);
  const Eigen::Vector3d vector = sine / norm * angle;
  return {cosine, vector[0], vector[1], vector[2]};
}

Eigen::Vector3d angular_velocity(const Rotation& rotation, const Eigen::Vector3d& inertia) {
  const Eigen::Vector3d local = rotation.orientation.conjugate() * rotation.angular_momentum;
  return rotation.orientation * local.cwiseQuotient(inertia);
}

Rotation rotate_free(const Rotation& start, const Eigen::Vector3d& inertia,
                     const Eigen::Vector3d& torque, double time, bool rough) {
  Rotation r = start;
  if (inertia[0] == inertia[1] && inertia[1] == inertia[2]) {
    const Eigen::Vector3d mean = (start.angular_momentum + 0.5 * time * torque) / inertia[0];
    r.angular_momentum += time * torque;
    r.orientation = rotation_of(time * mean) * start.orientation;
    return r;
  }
  r.angular_momentum += time * torque;
  switch (common_axis(inertia)) {
    case 0:
      r.orientation = split_rotation<0>(start, inertia, torque, time, rough);
      break;
    case 1:
      r.orientation = split_rotation<1>(start, inertia, torque, time, rough);
      break;
    default:
      r.orientation = split_rotation<2>(start, inertia, torque, time, rough);
  }
  return r;
}

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
  Rotation start;
  start.orientation = body.orientation * body.principal;
  start.angular_momentum = momentum_of(start.orientation, body.inertia, omega);
  const Eigen::Vector3d euler = momentum_of(start.orientation, body.inertia, alpha);
  const Eigen::Vector3d gyroscopic = omega.cross(start.angular_momentum);
  Eigen::Vector3d torque = euler + gyroscopic;
  // A free spin is exact and cheaper without the rounding error of the two.
  if (torque.squaredNorm() <= kNoTorque * kNoTorque * gyroscopic.squaredNorm()) torque.setZero();
  motion.end = rotate_free(start, body.inertia, torque, step, rough);
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
  const Eigen::Vector3d omega = end.orientation * end.velocity.tail<3>();
  const Eigen::Vector3d arm = end.orientation * end.offset;
  const Eigen::Vector3d centre_velocity = end.velocity.head<3>() + omega.cross(arm);
  const Eigen::Vector3d way = end.origin + arm - start.origin - start.orientation * start.offset;
  const double translation =
      0.5 * start.mass * (centre_velocity.squaredNorm() - motion.centre_velocity.squaredNorm()) -
      start.mass * motion.centre_acceleration.dot(way);
  const auto rotation_energy = [&](const Eigen::Vector3d& local) {
    return 0.5 * start.inertia.dot(local.cwiseProduct(local));
  };
  // Without contact the smooth torque does the work that the rotation gains.
  const double smooth = rotation_energy(motion.end.orientation.conjugate() *
                                        angular_velocity(motion.end, start.inertia));
  const double rotation =
      rotation_energy(start.principal.conjugate() * end.velocity.tail<3>()) - smooth;
  const Eigen::Vector3d alpha = start.orientation * start.acceleration.tail<3>();
  const Eigen::Quaterniond principal = start.orientation * start.principal;
  const Eigen::Vector3d torque =
      momentum_of(principal, start.inertia, alpha) +
      motion.angular_velocity.cross(momentum_of(principal, start.inertia, motion.angular_velocity));
  return translation + rotation - torque.dot(displacement.tail<3>());
}

double brake_rotation(FreeBody& body, double energy) {
  const Eigen::Vector3d local = body.principal.conjugate() * body.velocity.tail<3>();
  const double rotation = 0.5 * body.inertia.dot(local.cwiseProduct(local));
  if (rotation == 0.0) return 0.0;
  const double loss = 1.0 - std::sqrt(std::max(0.0, 1.0 - energy / rotation));
  // The centre of mass keeps its velocity.
  const Eigen::Vector3d arm = body.orientation * body.offset;
  const Eigen::Vector3d omega = body.orientation * body.velocity.tail<3>();
  body.velocity.head<3>() += loss * omega.cross(arm);
  body.velocity.tail<3>() *= 1.0 - loss;
  return std::min(energy, rotation);
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
