#include "dashpot/mujoco/mocap_pose.hpp"

#include <mujoco/mujoco.h>

#include <cmath>

namespace dashpot::host {

namespace {

// Offset (m, rad) at which a slow follower has arrived: far below what rigid contacts give way by.
constexpr double kArrived = 1e-9;

// The rotation vector, world, from one orientation to another.
MocapVector rotation_between(const double* from, const double* to) {
  mjtNum inverse[4], difference[4];
  MocapVector angle;
  mju_negQuat(inverse, from);
  mju_mulQuat(difference, to, inverse);
  mju_quat2Vel(angle.data(), difference, 1.0);
  return angle;
}

}  // namespace

void rotate(double* quaternion, const MocapVector& angle) {
  mjtNum axis[3], turn[4], result[4];
  mju_copy3(axis, angle.data());
  const mjtNum size = mju_normalize3(axis);
  mju_axisAngle2Quat(turn, axis, size);
  mju_mulQuat(result, turn, quaternion);
  mju_normalize4(result);
  mju_copy4(quaternion, result);
}

MocapVector offset(const MocapPose& from, const MocapPose& to) {
  return {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
}

MocapVector turn(const MocapPose& from, const MocapPose& to) {
  return rotation_between(from.data() + 3, to.data() + 3);
}

void move(MocapPose& pose, const MocapVector& way, const MocapVector& angle) {
  for (int i = 0; i < 3; ++i) pose[i] += way[i];
  rotate(pose.data() + 3, angle);
}

bool is_pose(const MocapPose& pose) {
  double sum = 0.0;
  for (double x : pose) sum += x;
  return std::isfinite(sum) && std::abs(mju_norm(pose.data() + 3, 4) - 1.0) < 0.5;
}

void follow(double time_constant, double time, MocapVector& x, MocapVector& rate) {
  if (time_constant == 0.0) {
    x = rate = {};
    return;
  }
  const double decay = std::exp(-time / time_constant);
  for (int i = 0; i < 3; ++i) {
    const double c = rate[i] + x[i] / time_constant;
    x[i] = (x[i] + c * time) * decay;
    rate[i] = (rate[i] - c * time / time_constant) * decay;
  }
  if (mju_norm3(x.data()) > kArrived || mju_norm3(rate.data()) * time_constant > kArrived) return;
  x = rate = {};
}

}  // namespace dashpot::host
