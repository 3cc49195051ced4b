#include "dashpot/mujoco/mocap_jumps.hpp"

#include <mujoco/mujoco.h>

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
constexpr double kApartTurn = 0.1;  // rad

// Whether poses are farther from each other than `length` (m) or `angle` (rad).
bool are_apart(const MocapPose& a, const MocapPose& b, double length, double angle) {
  return mju_norm3(offset(a, b).data()) > length || mju_norm3(turn(a, b).data()) > angle;
}

// The sum of the squared violations (m^2, rad^2) of what a mocap body in a pose holds.
double violation(const mjModel* m, mjData* d, size_t index, MocapPlaces& places,
                 const MocapPose& pose) {
  places.put(index, pose);
  d->ncon = 0;
  d->parena = 0;  // as in MocapMotion::find_constraints
  mj_fwdKinematics(m, d);
  mj_makeConstraint(m, d);
  double sum = 0.0;
  for (int row = 0; row < d->ne; ++row)
    if (holds(m, d->efc_id[row], static_cast<int>(index))) sum += d->efc_pos[row] * d->efc_pos[row];
  return sum;
}

}  // namespace

bool is_far(const mjModel* m, const MocapPose& from, const MocapPose& to) {
  return are_apart(from, to, kJump * metre(m), kJumpTurn);
}

RememberedMocap at_rest(const MocapPose& command) {
  RememberedMocap mocap{};
  mocap.command = mocap.pose = command;
  return mocap;
}

// It is one unless what it holds has been taken along: no farther from the new pose than from the
// old one.
void settle_jump(const mjModel* m, mjData* d, size_t index, MocapPlaces& places,
                 RememberedMocap& now) {
  const double there = violation(m, d, index, places, now.command);
  if (!(there > violation(m, d, index, places, now.pose))) now = at_rest(now.command);
}

void settle_start(const mjModel* m, mjData* d, size_t index, MocapPlaces& places,
                  RememberedMocap& now) {
  const double apart = violation(m, d, index, places, now.command);
  const MocapPose met = pose_where_met(m, d, static_cast<int>(index), now.command);
  const bool far = are_apart(met, now.command, kApart * metre(m), kApartTurn);
  if (far && violation(m, d, index, places, met) < apart) now.pose = met;
}

}  // namespace dashpot::host
