// Accurate motion of one free rigid body over a step: parabola of the centre of mass under a
// constant force, rotation under a constant world torque (free_rotation.hpp), impulses and
// displacements of contacts on top.

#pragma once

#include <Eigen/Geometry>

#include "dashpot/rows/free_rotation.hpp"

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

// Motion over a step without contact.
struct FreeMotion {
  FreeBody start;
  Eigen::Quaterniond frame;             // attitude at which contacts see the body, see freeze_at
  Eigen::Vector3d arm;                  // origin to centre of mass in that attitude, world
  Eigen::Vector3d centre_velocity;      // at the start, m/s
  Eigen::Vector3d centre_acceleration;  // m/s^2
  Eigen::Vector3d angular_velocity;     // world, at the start, rad/s
  Eigen::Vector3d torque;               // smooth, world, N m
  Rotation end;
};
// Frozen at the start.
FreeMotion predict_free_motion(const FreeBody& body, double step, bool rough = false);

// Freezes the geometry, and so the body frame, at another attitude of the step.
void freeze_at(FreeMotion& motion, const Eigen::Quaterniond& orientation);

// Adds to the smooth load a wrench (world) at the centre of mass.
void add_load(FreeMotion& motion, double step, const Vector6& wrench);

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

// Kinetic energy of the centre of mass and of the rotation about it, J.
double kinetic_energy(const FreeBody& body);

// Takes `energy` (J) out of the body's rotation, or all that is there. Returns what it took.
double brake_rotation(FreeBody& body, double energy);

// Takes `energy` (J) out of what contacts gave the translation of the centre of mass, whose
// velocity they changed by `change` (m/s, world), as far as they gave it any. Returns what it took.
double brake_translation(FreeBody& body, const Eigen::Vector3d& change, double energy);

// The coordinates of a free body (trees.hpp) without their zeros.
Vector6 without_zeros(const double* coordinates);

// The same between generalized coordinates (origin, body frame) and the centre of mass (world axes)
// in the frozen frame: velocities and accelerations go to the centre, forces come from there.
Vector6 motion_of_centre(const FreeMotion& motion, const Vector6& generalized);
Vector6 motion_of_origin(const FreeMotion& motion, const Vector6& centre);
Vector6 generalized_force(const FreeMotion& motion, const Vector6& wrench);
// The wrench at the centre of mass that accelerates the body in the frozen frame.
Vector6 wrench_of(const FreeMotion& motion, const Vector6& centre_acceleration);

}  // namespace dashpot
