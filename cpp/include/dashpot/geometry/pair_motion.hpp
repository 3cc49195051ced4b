// How two geoms move against each other in the rest of a step: bounds on how fast they approach and
// turn, for constant acceleration of their bodies.

#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>

#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Motion in a step (of the thinner geom's half-width) and turn (rad) that make a pair fast.
inline constexpr double kFastMotion = 0.25;
inline constexpr double kFastTurn = 0.05;

struct SideMotion {
  int geom = 0;
  int tree = -1;
  bool is_free = false;           // its body is free, or fixed
  Motion velocity, acceleration;  // of its body; `centre` is unused in the latter
  double offset = 0.0;            // m, of the geom's centre from the body's centre of mass
  double core_radius = 0.0;       // m, about the geom's centre
  double curvature_radius = std::numeric_limits<double>::infinity();  // m, least of a round shape
  // Axis of a shape of revolution, unit; zero for others.
  Eigen::Vector3d symmetry = Eigen::Vector3d::Zero();

  // Mean rate of turn (rad/s) over `length` (s).
  Eigen::Vector3d turn(double length) const;
  // The turn that moves the shape about its own centre.
  Eigen::Vector3d shape_turn(double length) const;
  // Bound on the speed of its points, m/s, from turning.
  double turning_speed(double length) const;
  // Constant motion that covers what the body does in `length`: a free body (or a small turn)
  // about its centre of mass, another about its instantaneous axis.
  Motion mean_motion(double length) const;
};

struct PairMotion {
  std::array<SideMotion, 2> side;
  double half_width = 0.0;     // m, of the thinner geom
  double release_speed = 0.0;  // m/s, that its compressed contacts can give it
  bool has_plane = false;
  bool flies = false;  // both sides are free bodies or fixed

  std::array<int, 2> geoms() const { return {side[0].geom, side[1].geom}; }
  // Bound on the speed at which points of the two approach along `normal`, or in any direction.
  double closing_speed(const Eigen::Vector3d& normal, double length) const;
  double closing_speed(double length) const;
  // Rate of turn of either side, with that which an impact at `speed` can give it, or of the normal
  // of two round shapes that move along each other.
  double turn_rate(double speed, const Eigen::Vector3d& normal, double length) const;
  // Whether motion at `speed` over a whole `step` (s) is no longer small.
  bool is_fast(double speed, const Eigen::Vector3d& normal, double length, double step) const;
  // Distance (m) where flight ends: covers how motion over `length` departs from constant velocity.
  double standoff(double length) const;

 private:
  Eigen::Vector3d relative_velocity(double length) const;
};

}  // namespace dashpot
