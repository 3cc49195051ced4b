#include "dashpot/integrate/drive_changes.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/trees.hpp"

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

// What goes on of two changes, one after the other: all of the second unless one is a jump.
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

void DriveChanges::start(const mjModel_* model, const mjData_* d,
                         const std::vector<double>& velocity) {
  host::drives(model, d, velocity, drive_);
  commanded_change_.assign(drive_.size(), 0.0);
  followed_.assign(drive_.size(), 0.0);
}

void DriveChanges::find(const mjModel_* model, const mjData_* d, const HeldMotion& before,
                        const Trees& trees, const std::vector<char>& left_corrector) {
  followed_change_.assign(drive_.size(), 0.0);
  if (std::none_of(left_corrector.begin(), left_corrector.end(), [](char left) { return left; }))
    return;
  host::servo_changes(model, d, before.displacement, servo_change_);
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_corrector[index] || host::is_free_body(model, index)) continue;
    const Tree& t = trees.tree[index];
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
      commanded_change_[i] = drive_[i] - before.drive[i] - servo_change_[i];
      followed_[i] = before.followed[i];
      const double steady = steady_part(before.commanded_change[i], commanded_change_[i]);
      const double jump = commanded_change_[i] - steady;
      followed_change_[i] =
          servo_change_[i] + steady + part_taken_back(jump, followed_[i] + steady);
    }
  }
}

void DriveChanges::count_followed(const Tree& t, double s) {
  for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
    followed_[i] += s * (followed_change_[i] - servo_change_[i]);
}

void DriveChanges::keep(const mjModel_* model, const Trees& trees, int tree, const double* before,
                        const double* velocity, HeldMotion& now) const {
  const Tree& t = trees.tree[tree];
  std::copy_n(drive_.begin() + t.dof_begin, t.dof_count, now.drive + t.dof_begin);
  for (int j = 0; j < t.dof_count && t.damped && host::takes_derivatives(model); ++j) {
    const double change = velocity[t.dof_begin + j] - before[t.dof_begin + j];
    now.drive[t.dof_begin + j] -= trees.damping[t.begin + j] * change;
    for (int i = 0; i < t.dof_count && t.cross_damped; ++i)
      now.drive[t.dof_begin + i] -= trees.cross_damping[t.inverse + j * t.count + i] * change;
  }
  std::copy_n(commanded_change_.begin() + t.dof_begin, t.dof_count,
              now.commanded_change + t.dof_begin);
  std::copy_n(followed_.begin() + t.dof_begin, t.dof_count, now.followed + t.dof_begin);
}

}  // namespace dashpot
