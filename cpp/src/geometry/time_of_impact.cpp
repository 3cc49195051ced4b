// Conservative advancement with a second-order bound.
//
// At time t let n be the direction between the closest points. From the bounds of moving_shape.hpp,
// the gap along n is, tau later, at least
//
//     G(tau) = min_b b.(n + tau n x w2) - max_a a.(n + tau n x w1) + tau (...) - K tau^2 / 2
//              + min(0, n.(a2 - a1)) tau^2 / 2 ,
//
// a concave function that costs two support points to evaluate. The bodies stay apart up to its
// root, to which time advances, and n is found again. Near contact each advance leaves a gap
// quadratic in the one before.
//
// Where the surface next to the gap is a face that turns, its far corners soon limit G. After a few
// advances, n may also turn with either of the bodies, whose heights then stay as they are.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/geometry/query.hpp"
#include "height_field.hpp"
#include "moving_shape.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr int kMostRootRounds = 40;  // far more than it takes
constexpr int kPatience = 16;        // advances along fixed directions before these may turn

double extent(const Shape& shape) {
  return shape.type == ShapeType::kPlane ? 0.0 : core_extent(shape) + sweep_radius(shape);
}

// Lower bound of the gap along a direction that turns at `rate` from `normal`, for tau up to
// `longest`. The centres part along it by n(tau).(offset + tau velocity), expanded like the rest.
double turning_clearance(const MovingShape& body1, const MovingShape& body2, const Vector3d& normal,
                         const Vector3d& rate, double longest, double tau) {
  const Vector3d offset = body2.motion.centre - body1.motion.centre;
  const Vector3d velocity = body2.motion.linear - body1.motion.linear;
  const double acceleration = (body2.motion.acceleration - body1.motion.acceleration).norm();
  const double speed = velocity.norm() + longest * acceleration;
  const Vector3d turned = rate.cross(normal);
  const double curvature =
      turned.norm() * (rate.norm() * (offset.norm() + longest * speed) + 2.0 * speed) +
      acceleration;
  return normal.dot(offset) + tau * (turned.dot(offset) + normal.dot(velocity)) -
         0.5 * curvature * tau * tau + body2.turning_height(normal, rate, -1.0, tau) -
         body1.turning_height(normal, rate, 1.0, tau);
}

// A time in [0, longest] up to which a concave clearance, positive at 0, stays so: `longest` if it
// is positive there, else one that leaves between nothing and a thousandth of the clearance, as
// good as the next direction can use.
template <typename Clearance>
double safe_time(const Clearance& clearance, double longest, double touching) {
  double safe = 0.0, safe_clearance = clearance(0.0);
  double unsafe = longest;
  const double unsafe_clearance = clearance(unsafe);
  if (safe_clearance <= 0.0) return 0.0;
  if (unsafe_clearance >= 0.0) return longest;
  const double enough = std::max(1e-3 * safe_clearance, 0.1 * touching);
  const double aim = 0.5 * enough;
  double safe_weight = safe_clearance - aim, unsafe_weight = unsafe_clearance - aim;
  int last_side = 0;
  for (int round = 0; round < kMostRootRounds && safe_clearance > enough; ++round) {  // Illinois
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
  return safe;
}

TimeOfImpact convex_time_of_impact(const Shape& shape1, const Pose& pose1, const Motion& motion1,
                                   const Shape& shape2, const Pose& pose2, const Motion& motion2,
                                   double horizon, double margin) {
  MovingShape body1 = make_moving(shape1, pose1, motion1);
  MovingShape body2 = make_moving(shape2, pose2, motion2);
  const double touching = kTouchingGap * (extent(shape1) + extent(shape2));

  const bool has_plane = shape1.type == ShapeType::kPlane || shape2.type == ShapeType::kPlane;

  TimeOfImpact result;
  for (; result.evaluations < kMostDistances;) {
    const auto place = [&](MovingShape& body, const Pose& pose, const Motion& motion) {
      body.pose = advance(pose, motion, result.time);
      body.motion.centre = motion.centre + motion.way(result.time);
      body.motion.linear = motion.linear + result.time * motion.acceleration;
    };
    place(body1, pose1, motion1);
    place(body2, pose2, motion2);
    result.at = distance(shape1, body1.pose, shape2, body2.pose);
    ++result.evaluations;
    const Vector3d& normal = result.at.normal;
    const double coming =
        std::min(0.0, normal.dot(body2.motion.acceleration - body1.motion.acceleration));
    const auto clearance = [&](double tau) {
      return body2.height(normal, -1.0, tau) - body1.height(normal, 1.0, tau) +
             0.5 * coming * tau * tau - margin - 0.5 * touching;
    };
    if (std::min(clearance(0.0) + 0.5 * touching, result.at.distance - margin) <= touching) {
      result.hit = true;
      return result;
    }
    const double remaining = horizon - result.time;
    if (remaining <= 0.0) return result;
    double safe = safe_time(clearance, remaining, touching);
    if (result.evaluations > kPatience && !has_plane) {
      for (const MovingShape* leader : {&body1, &body2}) {
        const Vector3d& rate = leader->motion.angular;
        if (rate.isZero(0.0)) continue;
        const auto turning = [&](double tau) {
          return turning_clearance(body1, body2, normal, rate, remaining, tau) - margin -
                 0.5 * touching;
        };
        safe = std::max(safe, safe_time(turning, remaining, touching));
      }
    }
    if (safe == 0.0 || result.time + safe == result.time) {
      // The time left to contact is below the resolution of the clock.
      result.hit = true;
      return result;
    }
    result.time = safe == remaining ? horizon : result.time + safe;
  }
  throw UndecidedImpact("time of impact: no decision in " + std::to_string(kMostDistances) +
                        " distances");
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
  if (is_field1 && is_field2)
    throw std::invalid_argument("two height fields: queries do not cover this pair");
  if (is_field2) {
    TimeOfImpact found =
        time_of_impact(shape2, pose2, motion2, shape1, pose1, motion1, horizon, margin);
    found.at = swapped(found.at);
    return found;
  }
  if (is_field1 && !(motion1.acceleration.isZero(0.0) && motion2.acceleration.isZero(0.0)))
    throw std::invalid_argument(
        "time of impact with a height field along a parabola is not defined");
  if (is_field1 && shape2.type == ShapeType::kPlane) {
    return time_of_impact(height_field_hull(shape1.field), pose1, motion1, shape2, pose2, motion2,
                          horizon, margin);
  }
  if (is_field1) {
    return height_field_time_of_impact(shape1.field, pose1, motion1, shape2, pose2, motion2,
                                       horizon, margin);
  }
  return convex_time_of_impact(shape1, pose1, motion1, shape2, pose2, motion2, horizon, margin);
}

}  // namespace dashpot
