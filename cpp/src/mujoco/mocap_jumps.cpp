#include "dashpot/mujoco/mocap_jumps.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco/mocap_bodies.hpp"
#include "dashpot/mujoco/properties.hpp"

namespace dashpot::host {

namespace {

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

}  // namespace

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
