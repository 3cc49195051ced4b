#include "dashpot/model/mocap_bodies.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/properties.hpp"
#include "equalities.hpp"

namespace dashpot::host {

namespace {

// The mocap body that a body is or is fixed to; -1 for none.
int mocap_of(const mjModel* m, int body) {
  return m->body_treeid[body] < 0 ? m->body_mocapid[m->body_rootid[body]] : -1;
}

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

// Jumps in one step that are no motion: at 2 ms they would be 50 m/s and 250 rad/s.
constexpr double kJump = 0.1;      // m
constexpr double kJumpTurn = 0.5;  // rad
// Beyond these a mocap body has left behind what it holds: at MuJoCo's default solref a weld is
// stretched by 2 cm under a hundred weights, which is what springs bear without memory.
constexpr double kApart = 0.02;     // m
constexpr double kLongAgo = -1e6;   // s, when what nothing is known of was told its pose
constexpr double kApartTurn = 0.1;  // rad

constexpr double kArm = 0.1;  // m
// Speed (m/s) at which a body goes to a pose, or so much faster than it was told to go before, or
// up to a speed that no motion before has to bear out.
constexpr double kSlow = 0.25, kPursuit = 1.25, kQuick = 1.0;
// Poses have a rhythm where so many time constants, at most, go by between them.
constexpr double kRhythm = 5.0;
// An interval that is shorter than the rhythm by no more than this factor shortens it slowly.
constexpr double kUneven = 1.5, kFading = 0.9;
constexpr double kSliver = 1e-9;  // of a time, by which sums of steps are off at most

// Whether poses are farther from each other than `length` (m) or `angle` (rad).
bool are_apart(const MocapPose& a, const MocapPose& b, double length, double angle) {
  return mju_norm3(offset(a, b).data()) > length || mju_norm3(turn(a, b).data()) > angle;
}

// An acceleration grows steadily where it grew as much in the step before, but for this part of the
// larger growth; where it does not, it is at most so many times that of the step before.
constexpr double kSteadyGrowth = 0.5, kMostGrowth = 2.0;

double norm(const MocapVector& v) { return mju_norm3(v.data()); }
MocapVector times(double factor, const MocapVector& v) {
  return {factor * v[0], factor * v[1], factor * v[2]};
}
MocapVector difference(const MocapVector& from, const MocapVector& to) {
  return {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
}

// How far a way goes (m), with what it turns points a tenth of a metre away by.
double size_of(const mjModel* m, const MocapVector& way, const MocapVector& angle) {
  return std::max(mju_norm3(way.data()), kArm * metre(m) * mju_norm3(angle.data()));
}

// Position (m) and quaternion that a mocap body with the pose `pose`, which the kinematics in `d`
// are of, would need for the first of its active connects and welds to be met; `pose` without any.
std::array<double, 7> pose_where_met(const mjModel_* m, const mjData_* d, int mocap,
                                     const std::array<double, 7>& pose) {
  for (int i = 0; i < m->neq; ++i) {
    if (!d->eq_active[i] || !holds(m, i, mocap)) continue;
    const EqualitySide side[2] = {side_of(m, d, i, 0), side_of(m, d, i, 1)};
    const int own = mocap_of(m, side[0].body) == mocap ? 0 : 1;
    return where_met(side[own], side[1 - own], m->eq_type[i] == mjEQ_WELD, pose);
  }
  return pose;
}

}  // namespace

bool holds(const mjModel_* m, int equality, int mocap) {
  const std::array<int, 2> body = joined_bodies(m, equality);
  return mocap_of(m, body[0]) == mocap || mocap_of(m, body[1]) == mocap;
}

bool holds_anything(const mjModel_* m, const mjData_* d, int mocap) {
  for (int i = 0; i < m->neq; ++i)
    if (d->eq_active[i] && holds(m, i, mocap)) return true;
  return false;
}

std::vector<int> driven_bodies(const mjModel_* m) {
  std::vector<int> bodies(m->nmocap);
  for (int id = 1; id < m->nbody; ++id) {
    if (const int mocap = m->body_mocapid[id]; mocap >= 0)
      bodies[mocap] = id;
    else if (m->body_parentid[id] == 0 && is_fixed(m, id))
      bodies.push_back(id);
  }
  return bodies;
}

bool is_fixed(const mjModel_* m, int body) { return m->body_treeid[body] < 0; }

const double* mocap_twist(const mjModel_* m, const mjData_* d, int body) {
  const int root = m->body_rootid[body];
  return root > 0 && is_fixed(m, root) ? d->cvel + 6 * root : nullptr;
}

bool is_held_by_mocap(const mjModel_* m, int equality) {
  if (m->nmocap == 0) return false;
  const std::array<int, 2> body = joined_bodies(m, equality);
  return mocap_of(m, body[0]) >= 0 || mocap_of(m, body[1]) >= 0;
}

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

bool is_known(const RememberedMocap& mocap) {
  double sum = mocap.length + mocap.told_at + mocap.rhythm + mocap.speed + mocap.left;
  for (const MocapVector* rate :
       {&mocap.velocity, &mocap.angular, &mocap.mean.velocity, &mocap.mean.change,
        &mocap.mean.growth, &mocap.mean_angular.velocity, &mocap.mean_angular.change,
        &mocap.mean_angular.growth})
    sum += mju_norm3(rate->data());
  return is_pose(mocap.command) && is_pose(mocap.pose) && std::isfinite(sum);
}

bool is_far(const mjModel* m, const MocapPose& from, const MocapPose& to) {
  return are_apart(from, to, kJump * metre(m), kJumpTurn);
}

RememberedMocap at_rest(const MocapPose& command) {
  RememberedMocap mocap{};
  mocap.command = mocap.pose = command;
  mocap.told_at = kLongAgo;
  return mocap;
}

void tell(const mjModel* m, double time, const MocapPose& command, bool follows,
          double time_constant, RememberedMocap& now) {
  const double step = m->opt.timestep, unit = metre(m), since = time - now.told_at;
  const double told = std::abs(since - step) <= kSliver * step ? step : since;  // of sums of steps
  const double way = size_of(m, offset(now.command, command), turn(now.command, command));
  const double rest = size_of(m, offset(now.pose, command), turn(now.pose, command));
  now.command = command;
  now.told_at = time;
  now.left = 0.0;
  if (follows) return;
  if (time_constant == 0.0) {
    now.left = step;
  } else if (!(told >= 0.0 && told <= (1.0 + kSliver) * kRhythm * time_constant)) {
    now.left = std::clamp(rest / (kSlow * unit), step, std::max(step, time_constant));
    now.rhythm = now.speed = 0.0;
  } else {
    const bool even = told <= now.rhythm && now.rhythm <= kUneven * told;
    now.rhythm = even ? told + kFading * (now.rhythm - told) : told;
    const double interval = std::max(step, now.rhythm), speed = way / interval;
    const double borne_out = std::min(speed, std::max(kQuick * unit, now.speed));
    now.left = std::max(interval, rest / std::max(kSlow * unit, kPursuit * borne_out));
    now.speed = speed;
  }
}

void settle(const mjModel* m, mjData* d, size_t index, MocapPlaces& places, RememberedMocap& now) {
  places.put(index, now.command);
  mj_fwdKinematics(m, d);
  const MocapPose met = pose_where_met(m, d, static_cast<int>(index), now.command);
  if (are_apart(met, now.command, kApart * metre(m), kApartTurn))
    now.pose = met;
  else
    now = at_rest(now.command);
}

MocapVector accelerate(const MocapVector& velocity, double between, MeanRate& mean) {
  const MeanRate before = mean;
  mean.velocity = velocity;
  mean.change = times(1.0 / between, difference(before.velocity, velocity));
  const MocapVector growth = difference(before.change, mean.change);
  // What sets out had no acceleration that could grow.
  const bool sets_out = norm(before.change) + norm(before.growth) < kSteadyGrowth * norm(growth);
  mean.growth = sets_out ? MocapVector{} : growth;
  MocapVector ahead = mean.change;
  mju_addToScl3(ahead.data(), growth.data(), 0.5);
  if (norm(difference(before.growth, growth)) <=
      kSteadyGrowth * std::max(norm(growth), norm(before.growth)))
    return ahead;
  const double along = mju_dot3(ahead.data(), before.change.data());
  if (along <= 0.0) return {};
  return times(std::min(1.0, kMostGrowth * along / mju_dot3(ahead.data(), ahead.data())), ahead);
}

}  // namespace dashpot::host
