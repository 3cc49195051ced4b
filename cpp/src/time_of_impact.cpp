// Conservative advancement with a second-order bound.
//
// At time t let n be the direction between the closest points. From the bounds of moving_shape.hpp,
// the gap along n is, tau later, at least
//
//     G(tau) = min_b b.(n + tau n x w2) - max_a a.(n + tau n x w1) + tau (...) - K tau^2 / 2 ,
//
// a concave function that costs two support points to evaluate. The bodies stay apart up to its
// root, to which time advances, and n is found again. Near contact each advance leaves a gap
// quadratic in the one before.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/height_field.hpp"
#include "dashpot/moving_shape.hpp"
#include "dashpot/query.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr int kMaxAdvances = 10000;
constexpr int kMaxRootRounds = 40;

double extent(const Shape& shape) {
  return shape.type == ShapeType::kPlane ? 0.0 : core_extent(shape) + sweep_radius(shape);
}

}  // namespace

TimeOfImpact time_of_impact(const Shape& shape1, const Pose& pose1, const Motion& motion1,
                            const Shape& shape2, const Pose& pose2, const Motion& motion2,
                            double horizon, double margin) {
  if (!(horizon > 0.0) || !std::isfinite(horizon)) {
    throw std::invalid_argument("horizon = " + std::to_string(horizon) +
                                " s must be positive and finite");
  }
  const bool is_field1 = shape1.type == ShapeType::kHeightField;
  const bool is_field2 = shape2.type == ShapeType::kHeightField;
  if (is_field1 && is_field2) {
    throw std::invalid_argument("two height fields: queries do not cover this pair");
  }
  if (is_field2) {
    TimeOfImpact found =
        time_of_impact(shape2, pose2, motion2, shape1, pose1, motion1, horizon, margin);
    found.at = swapped(found.at);
    return found;
  }
  if (is_field1 && shape2.type == ShapeType::kPlane) {
    return time_of_impact(height_field_hull(shape1.field), pose1, motion1, shape2, pose2, motion2,
                          horizon, margin);
  }
  if (is_field1) {
    return height_field_time_of_impact(shape1.field, pose1, motion1, shape2, pose2, motion2,
                                       horizon, margin);
  }
  MovingShape body1 = make_moving(shape1, pose1, motion1);
  MovingShape body2 = make_moving(shape2, pose2, motion2);
  const double touching = kTouchingGap * (extent(shape1) + extent(shape2));

  TimeOfImpact result;
  for (; result.evaluations < kMaxAdvances;) {
    const auto place = [&](MovingShape& body, const Pose& pose, const Motion& motion) {
      body.pose = advance(pose, motion, result.time);
      body.motion.centre = motion.centre + result.time * motion.linear;
    };
    place(body1, pose1, motion1);
    place(body2, pose2, motion2);
    result.at = distance(shape1, body1.pose, shape2, body2.pose);
    ++result.evaluations;
    const Vector3d& normal = result.at.normal;
    const auto clearance = [&](double tau) {
      return body2.height(normal, -1.0, tau) - body1.height(normal, 1.0, tau) - margin -
             0.5 * touching;
    };

    double safe = 0.0, safe_clearance = clearance(0.0);
    if (std::min(safe_clearance + 0.5 * touching, result.at.distance - margin) <= touching) {
      result.hit = true;
      return result;
    }
    const double remaining = horizon - result.time;
    if (remaining <= 0.0) return result;
    double unsafe = remaining;
    const double unsafe_clearance = clearance(unsafe);
    if (unsafe_clearance >= 0.0) {
      result.time = horizon;
      continue;
    }
    // Illinois on a concave function between a safe and an unsafe time, for a time that leaves
    // between nothing and a thousandth of the gap, as good as the next direction can use.
    const double enough = std::max(1e-3 * safe_clearance, 0.1 * touching);
    const double aim = 0.5 * enough;
    double safe_weight = safe_clearance - aim, unsafe_weight = unsafe_clearance - aim;
    int last_side = 0;
    for (int round = 0; round < kMaxRootRounds && safe_clearance > enough; ++round) {
      const double tau = safe + (unsafe - safe) * safe_weight / (safe_weight - unsafe_weight);
      if (!(tau > safe && tau < unsafe)) break;
      const double value = clearance(tau);
      if (value >= 0.0) {
        safe = tau;
        safe_clearance = value;
        safe_weight = value - aim;
        if (safe_weight <= 0.0) break;
        if (last_side > 0) unsafe_weight *= 0.5;
        last_side = 1;
      } else {
        unsafe = tau;
        unsafe_weight = value - aim;
        if (last_side < 0) safe_weight *= 0.5;
        last_side = -1;
      }
    }
    if (safe == 0.0 || result.time + safe == result.time) {
      // The time left to contact is below the resolution of the clock.
      result.hit = true;
      return result;
    }
    result.time += safe;
  }
  throw std::runtime_error("time of impact: no convergence in " + std::to_string(kMaxAdvances) +
                           " distances");
}

}  // namespace dashpot
