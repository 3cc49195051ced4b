// Poses of mocap bodies and the ways between them.

#pragma once

#include <array>

namespace dashpot::host {

using MocapVector = std::array<double, 3>;  // world
using MocapPose = std::array<double, 7>;    // position (m) and unit quaternion

// From one pose to another: translation (m), and rotation vector (rad, world).
MocapVector offset(const MocapPose& from, const MocapPose& to);
MocapVector turn(const MocapPose& from, const MocapPose& to);
// Moves a pose by both.
void move(MocapPose& pose, const MocapVector& way, const MocapVector& angle);
// Turns a quaternion by a rotation vector (rad, world).
void rotate(double* quaternion, const MocapVector& angle);
// Whether all of a pose is finite, and its quaternion about as long as 1.
bool is_pose(const MocapPose& pose);

// The critically damped follower (mocap_motion.hpp) of one of the two after a time (s): its offset
// from the commanded pose, and the rate of that.
void follow(double time_constant, double time, MocapVector& x, MocapVector& rate);

}  // namespace dashpot::host
