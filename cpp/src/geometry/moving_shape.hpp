// Bounds on where a moving shape reaches.
//
// A point x of a body that moves at the constant v about c and turns at w has, tau later, the
// height n.x(tau) within w_n r tau^2 / 2 of n.x + tau (n.v + (x - c).(n x w)), where w_n = |w| |n x
// w| and r is its distance from the axis of rotation. Balls swept about the core turn with nothing,
// so that only the core enters r.
//
// Along a direction that turns too, n(tau) = R(tau) n at the rate w', the offset of x from c has
// the height n(tau).(x - c)(tau) = m(tau).(x - c) with m = inv(R_body) R n, which starts at n with
// the rate (w' - w) x n and has a second derivative of at most |w' - w| (|w| + |w'|).

#pragma once

#include "dashpot/geometry/shape.hpp"

namespace dashpot {

struct MovingShape {
  const Shape& shape;
  Motion motion;  // `centre` and `linear` where `pose` is; heights leave out the acceleration
  Pose pose;
  double axis_radius = 0.0;    // m, of the core, about the axis of rotation
  double centre_radius = 0.0;  // m, of the core, about the centre; planes: unused

  // Bounds n.x over the shape, `sign` +1 from above and -1 from below, `tau` (s, >= 0) after
  // `pose`. The bound from above is convex in tau, that from below concave.
  double height(const Eigen::Vector3d& normal, double sign, double tau) const;
  // The same for the height over the moving centre along a direction that turns at `rate` (rad/s,
  // world) from `normal`. Not for planes.
  double turning_height(const Eigen::Vector3d& normal, const Eigen::Vector3d& rate, double sign,
                        double tau) const;
};

// Throws std::invalid_argument for a plane that turns.
MovingShape make_moving(const Shape& shape, const Pose& pose, const Motion& motion);

}  // namespace dashpot
