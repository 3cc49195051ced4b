// What forces of actuators, and those that users apply, have a part in of the second half of a
// step.

#include <algorithm>
#include <cmath>

#include "dashpot/motion/trapezoid.hpp"
#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/trees.hpp"

namespace dashpot {

namespace {

// Fraction of the larger of two changes, one after the other, that they differ by where a force
// jumps. What follows from a motion of rate omega differs by omega H, but where it turns.
constexpr double kJump = 0.5;

// What two changes, one after the other, have in common: the smaller if both have one sign.
double lasting_part(double before, double now) {
  if (before * now <= 0.0) return 0.0;
  return std::abs(before) < std::abs(now) ? before : now;
}

// What goes on as it is of two changes, one after the other: all of the second one unless one of
// them is a jump.
double steady_part(double before, double now) {
  const double jump = kJump * std::max(std::abs(before), std::abs(now));
  return std::abs(now - before) <= jump ? now : lasting_part(before, now);
}

// What of a jump takes back changes that were followed before.
double part_taken_back(double jump, double followed) {
  return jump * followed < 0.0 ? std::copysign(std::min(std::abs(jump), std::abs(followed)), jump)
                               : 0.0;
}

}  // namespace

void Trapezoid::find_drive_changes(const mjData_* d, const Memory& memory, const Trees& trees) {
  const HeldMotion before = memory.held_motion();
  followed_change_.assign(drive_.size(), 0.0);
  if (std::none_of(left_half_.begin(), left_half_.end(), [](char left) { return left; })) return;
  host::servo_changes(model_, d, before.displacement, servo_change_);
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_half_[index] || host::is_free_body(model_, index)) continue;
    const Tree& t = trees.tree[index];
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
      drive_change_[i] = drive_[i] - before.drive[i];
      commanded_change_[i] = drive_change_[i] - servo_change_[i];
      followed_[i] = before.followed[i];
      const double steady = steady_part(before.commanded_change[i], commanded_change_[i]);
      const double jump = commanded_change_[i] - steady;
      followed_change_[i] =
          servo_change_[i] + steady + part_taken_back(jump, followed_[i] + steady);
    }
  }
}

void Trapezoid::count_followed_changes(const Trees& trees) {
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_half_[index] || !coupled_[first_[index]].follows_drives) continue;
    const Tree& t = trees.tree[index];
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
      followed_[i] += coupled_[first_[index]].scale * (followed_change_[i] - servo_change_[i]);
  }
}

void Trapezoid::load_drives(double length, const Memory& memory, const Trees& trees,
                            RowData& data) {
  const HeldMotion before = memory.held_motion();
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_half_[index]) continue;
    const CoupledEnergy& coupled = coupled_[first_[index]];
    if (coupled.follows_drives || coupled.by_equalities) continue;
    const Tree& t = trees.tree[index];
    if (load_.empty()) load_.assign(drive_.size(), 0.0);
    const double ahead = 0.5 * std::min(1.0, length / before.length[index]);
    std::fill_n(force_.begin() + t.begin, t.count, 0.0);
    for (int i = 0; i < t.dof_count; ++i) {
      const int dof = t.dof_begin + i;
      load_[dof] = ahead * lasting_part(before.drive_change[dof], drive_change_[dof]);
      force_[t.begin + i] = load_[dof];
      followed_[dof] +=
          2.0 * ahead * lasting_part(before.commanded_change[dof], commanded_change_[dof]);
    }
    double* added = data.added_acceleration.data() + t.begin;
    add_response(trees, index, force_.data() + t.begin, added);
    for (int i = 0; i < t.dof_count; ++i) data.smooth_acceleration[t.begin + i] += added[i];
  }
}

}  // namespace dashpot
