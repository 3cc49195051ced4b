// Rotation of a free rigid body under a constant world torque.
//
// The rotation is split into one about the angular momentum and rotations about two principal axes,
// each an exact flow, composed symmetrically (Strang) and raised to sixth order by Yoshida's
// composition (Phys. Lett. A 150, 1990, solution A). Angular momentum is conserved to rounding and
// energy has no drift. The free rotation of a body of revolution is exact. Bodies with three equal
// moments turn with their mean angular velocity.

#pragma once

#include <Eigen/Geometry>

namespace dashpot {

// Orientation and angular momentum about the centre of mass.
struct Rotation {
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // principal frame to world
  Eigen::Vector3d angular_momentum = Eigen::Vector3d::Zero();       // world, kg m^2/s
};

// Angular velocity in the world, rad/s, of a body with principal moments `inertia` (kg m^2).
Eigen::Vector3d angular_velocity(const Rotation& rotation, const Eigen::Vector3d& inertia);

// Angular momentum, kg m^2/s, of a world `omega` (rad/s) at a principal orientation.
Eigen::Vector3d momentum_of(const Eigen::Quaterniond& orientation, const Eigen::Vector3d& inertia,
                            const Eigen::Vector3d& omega);

// The rotation by an angle (rad) about the axis along which it points.
Eigen::Quaterniond rotation_of(const Eigen::Vector3d& angle);

// Advances a rotation by `time` (s) under a constant world `torque` (N m); `rough`: to about 1e-6.
Rotation rotate_free(const Rotation& start, const Eigen::Vector3d& inertia,
                     const Eigen::Vector3d& torque, double time, bool rough = false);

}  // namespace dashpot
