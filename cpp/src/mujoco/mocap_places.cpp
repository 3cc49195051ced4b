#include "dashpot/mujoco/mocap_places.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
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

MocapPlaces::MocapPlaces(const mjModel* m, mjData* d, const std::vector<int>& body,
                         const std::vector<size_t>& started, std::vector<MocapPlace>& place)
    : model_(const_cast<mjModel*>(m)), data_(d), body_(body), started_(started), place_(place) {
  place.resize(body.size());
}

void MocapPlaces::start(size_t index) {
  MocapPlace& place = place_[index];
  place.given = place.placed = place.left = pose(index);
}

MocapPlaces::Numbers MocapPlaces::numbers(size_t index) const {
  if (index < static_cast<size_t>(model_->nmocap))
    return {data_->mocap_pos + 3 * index, data_->mocap_quat + 4 * index};
  return {model_->body_pos + 3 * body_[index], model_->body_quat + 4 * body_[index]};
}

MocapPose MocapPlaces::pose(size_t index) const {
  const Numbers from = numbers(index);
  MocapPose pose;
  std::copy_n(from.position, 3, pose.begin());
  std::copy_n(from.quaternion, 4, pose.begin() + 3);
  return pose;
}

MocapPlaces::~MocapPlaces() {
  for (size_t i : started_) {
    keep_what_was_set(i);
    put(i, place_[i].left);
  }
}

// Keeps the pose that a callback has set since the body was placed.
void MocapPlaces::keep_what_was_set(size_t index) {
  MocapPlace& place = place_[index];
  if (const MocapPose now = pose(index); now != place.placed) place.left = now;
}

void MocapPlaces::put(size_t index, const MocapPose& pose) {
  keep_what_was_set(index);
  place_[index].placed = pose;
  const Numbers to = numbers(index);
  std::copy_n(pose.begin(), 3, to.position);
  std::copy_n(pose.begin() + 3, 4, to.quaternion);
}

void MocapPlaces::update_fixed_bodies() {
  bool moved = false;
  for (size_t i = model_->nmocap; i < body_.size(); ++i) {
    mjtNum quaternion[4];
    mju_copy4(quaternion, model_->body_quat + 4 * body_[i]);
    mju_normalize4(quaternion);
    const mjtNum* position = model_->body_pos + 3 * body_[i];
    moved = moved || !std::equal(position, position + 3, data_->xpos + 3 * body_[i]) ||
            !std::equal(quaternion, quaternion + 4, data_->xquat + 4 * body_[i]);
  }
  if (!moved) return;
  const int flags = model_->opt.enableflags;
  model_->opt.enableflags &= ~mjENBL_SLEEP;
  mj_kinematics(model_, data_);
  mj_comPos(model_, data_);
  model_->opt.enableflags = flags;
}

}  // namespace dashpot::host
