#include "dashpot/rows/free_rotation.hpp"

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
// Composed steps at most: 2000 rad. A body that turns by more has no direction that one could know.
constexpr double kMostComposed = 1.0e5;
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
    const double resolved = std::ceil(turn / (rough ? kPredictedTurn : kComposedTurn));
    const int steps = static_cast<int>(resolved < kMostComposed ? resolved : kMostComposed);
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

Eigen::Vector3d momentum_of(const Eigen::Quaterniond& orientation, const Eigen::Vector3d& inertia,
                            const Eigen::Vector3d& omega) {
  return orientation * inertia.cwiseProduct(orientation.conjugate() * omega);
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

}  // namespace dashpot
