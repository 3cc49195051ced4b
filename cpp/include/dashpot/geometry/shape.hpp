// Shapes, their poses and their support functions.
//
// A convex shape is a core swept by a ball: the sphere is a point, the capsule a segment, each
// swept by a ball of its radius; every other shape is its own core, with radius 0. Sweeping shifts
// signed distances by exactly the radii, inside and outside, so all queries run on cores.

#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "dashpot/geometry/hull.hpp"

namespace dashpot {

enum class ShapeType {
  kPlane,
  kSphere,
  kCapsule,
  kCylinder,
  kEllipsoid,
  kBox,
  kHull,
  kHeightField
};

// A grid of heights above a base: row r and column c stand at y and x, evenly spaced over
// [-half_y, half_y] and [-half_x, half_x], with the top at z = elevation * heights[r * columns +
// c]. Every cell is two triangular prisms from z = -base up, split along the diagonal from its low
// to its high corner (low x and y, high x and y).
struct HeightField {
  int rows = 0, columns = 0;           // at least 2
  double half_x = 0.0, half_y = 0.0;   // m
  double elevation = 0.0;              // m, of a height of 1
  double base = 0.0;                   // m
  const float* heights = nullptr;      // rows * columns, borrowed
  std::string label = "height field";  // names it in errors
};

// A shape in its own frame, in MuJoCo's conventions (m); all but height fields are convex.
//   plane      the half-space z <= 0                 size unused
//   sphere     size[0] radius
//   capsule    size[0] radius, size[1] half-length of the segment along z
//   cylinder   size[0] radius, size[1] half-height along z
//   ellipsoid  size    semi-axes
//   box        size    half-lengths
//   hull       `hull`
//   field      the solid of `field`; has no core, radius or support point
struct Shape {
  ShapeType type = ShapeType::kSphere;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();
  std::shared_ptr<const Hull> hull;  // hull only, at least one corner
  HeightField field;                 // height field only
};

struct Pose {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();      // m, world
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  // columns: the shape's axes in the world
};

// A pose as seen from the frame of another one.
Pose relative_pose(const Pose& frame, const Pose& pose);

// Rigid motion: `centre` follows a parabola, at first at `linear`, the body turns about it at the
// constant world vector `angular`.
struct Motion {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();        // m, world
  Eigen::Vector3d linear = Eigen::Vector3d::Zero();        // m/s
  Eigen::Vector3d angular = Eigen::Vector3d::Zero();       // rad/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();  // m/s^2, constant

  // How far (m) the centre is after `time` (s).
  Eigen::Vector3d way(double time) const { return time * (linear + 0.5 * time * acceleration); }
};

// `pose` carried along `motion` for `time` seconds.
Pose advance(const Pose& pose, const Motion& motion, double time);

// Whether a shape has a core: planes (unbounded) and height fields (not convex) have none.
bool has_core(const Shape& shape);

// Radius (m) of the ball that sweeps the core of `shape`.
double sweep_radius(const Shape& shape);

// The point (world) of the core of `shape` that is furthest along `direction` (world, any length
// but zero). Of shapes that have a core.
Eigen::Vector3d core_support(const Shape& shape, const Pose& pose,
                             const Eigen::Vector3d& direction);

// Radius (m) of the smallest ball about the origin of the shape's frame that holds the core.
double core_extent(const Shape& shape);

// Largest distance (m) of a point of the core from the line through `centre` along `axis` (unit).
double core_axis_radius(const Shape& shape, const Pose& pose, const Eigen::Vector3d& centre,
                        const Eigen::Vector3d& axis);

// Throws std::invalid_argument naming `label` on sizes that are not positive and finite, or a hull
// without finite corners. Heights of a height field are checked where they are read.
void check_shape(const Shape& shape, const char* label);

}  // namespace dashpot
