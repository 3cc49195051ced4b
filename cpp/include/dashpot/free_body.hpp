// Accurate motion of one free rigid body over a step: parabola of the centre of mass under a
// constant force, rotation under a constant world torque, impulses and displacements of contacts
// on top.
//
// The rotation is split into one about the angular momentum and rotations about two principal axes,
// each an exact flow, composed symmetrically (Strang) and raised to sixth order by Yoshida's
// composition (Phys. Lett. A 150, 1990, solution A). Angular momentum is conserved to rounding and
// energy has no drift. The free rotation of a body of revolution is exact. Bodies with three equal
// moments turn with their mean angular velocity.

#pragma once

#include <Eigen/Geometry>

namespace dashpot {

using Vector6 = Eigen::Matrix<double, 6, 1>;

// State of a free body and the smooth load on it. Generalized velocities are those of MuJoCo's free
// joint: of the body frame's origin in the world, then angular in the body frame.
struct FreeBody {
  double mass = 0.0;                                              // kg
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();              // principal moments, kg m^2
  Eigen::Quaterniond principal = Eigen::Quaterniond::Identity();  // principal to body frame
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // centre of mass in the body frame, m
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // world, m
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // body frame to world
  Vector6 velocity = Vector6::Zero();                               // m/s, rad/s
  Vector6 acceleration = Vector6::Zero();                           // smooth, m/s^2, rad/s^2
};

// Orientation and angular momentum about the centre of mass.
struct Rotation {
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  // principal frame to world
  Eigen::Vector3d angular_momentum = Eigen::Vector3d::Zero();       // world, kg m^2/s
};

// Angular velocity in the world, rad/s, of a body with principal moments `inertia` (kg m^2).
Eigen::Vector3d angular_velocity(const Rotation& rotation, const Eigen::Vector3d& inertia);

// The rotation by an angle (rad) about the axis along which it points.
Eigen::Quaterniond rotation_of(const Eigen::Vector3d& angle);

// Advances a rotation by `time` (s) under a constant world `torque` (N m); `rough` within about
// 1e-6 instead of rounding.
Rotation rotate_free(const Rotation& start, const Eigen::Vector3d& inertia,
                     const Eigen::Vector3d& torque, double time, bool rough = false);

// Motion over a step without contact.
struct FreeMotion {
  FreeBody start;
  Eigen::Quaterniond frame;             // attitude at which contacts see the body, see freeze_at
  Eigen::Vector3d arm;                  // origin to centre of mass in that attitude, world
  Eigen::Vector3d centre_velocity;      // at the start, m/s
  Eigen::Vector3d centre_acceleration;  // m/s^2
  Eigen::Vector3d angular_velocity;     // world, at the start, rad/s
  Rotation end;
};
// Frozen at the start.
FreeMotion predict_free_motion(const FreeBody& body, double step, bool rough = false);

// Freezes the geometry, and so the body frame, at another attitude of the step.
void freeze_at(FreeMotion& motion, const Eigen::Quaterniond& orientation);

// Generalized velocity at the start, with the same motion of the centre of mass and the same
// angular velocity in the world, in the frozen frame.
Vector6 start_velocity(const FreeMotion& motion);

// Constant generalized acceleration that leads to the same end velocity in the frozen frame.
Vector6 mean_acceleration(const FreeMotion& motion, double step);

// The body at the end of the step; contacts changed the velocity of its centre of mass and its
// angular velocity by `velocity_change`, and moved and turned it by `displacement`, both in world
// axes. `acceleration` is left as it is.
FreeBody finish_free_motion(const FreeMotion& motion, double step, const Vector6& velocity_change,
                            const Vector6& displacement);

// Kinetic energy (J) that the motion from `motion.start` to `end`, which contacts moved and turned
// by `displacement`, gained beyond the work of the smooth load.
double energy_gain(const FreeMotion& motion, const Vector6& displacement, const FreeBody& end);

// Takes `energy` (J) out of the body's rotation, or all that is there. Returns what it took.
double brake_rotation(FreeBody& body, double energy);

// The same between generalized coordinates (origin, rotation in the body frame) and the centre of
// mass (world axes), in the frozen frame: velocities and accelerations go to the centre, forces
// come from there.
Vector6 motion_of_centre(const FreeMotion& motion, const Vector6& generalized);
Vector6 motion_of_origin(const FreeMotion& motion, const Vector6& centre);
Vector6 generalized_force(const FreeMotion& motion, const Vector6& wrench);
// The wrench at the centre of mass that accelerates the body in the frozen frame.
Vector6 wrench_of(const FreeMotion& motion, const Vector6& centre_acceleration);

}  // namespace dashpot
