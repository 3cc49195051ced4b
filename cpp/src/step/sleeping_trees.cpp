#include "sleeping_trees.hpp"

#include <algorithm>

#include "dashpot/model/sleep.hpp"

namespace dashpot {

bool SleepingTrees::wake_reached(const mjModel_* m, mjData_* d,
                                 const std::vector<ContactInput>& contacts,
                                 const std::vector<ConstraintInput>& constraints,
                                 const host::MocapMotion& mocap) const {
  if (!host::any_sleeps(m, d)) return false;
  bool any = false;
  const auto wake = [&](const std::array<int, 2>& trees, bool is_driven) {
    for (int side = 0; side < 2; ++side) {
      const int tree = trees[side], other = trees[1 - side];
      if (!host::sleeps(d, tree) || !(is_driven || (other >= 0 && !host::sleeps(d, other))))
        continue;
      host::wake(m, d, tree);
      any = true;
    }
  };
  for (const ContactInput& contact : contacts)
    wake(contact.tree, mocap.moves(contact.geom[0]) || mocap.moves(contact.geom[1]));
  for (const ConstraintInput& constraint : constraints)
    wake(constraint.tree, constraint.drive != 0.0);
  return any;
}

void SleepingTrees::leave_out(const mjModel_* m, const mjData_* d,
                              std::vector<ContactInput>& contacts,
                              std::vector<ConstraintInput>& constraints) {
  host::find_sleeping_rows(m, d, rows_);
  if (!host::any_sleeps(m, d)) return;
  const auto rests = [&](const auto& input) {
    return host::sleeps(d, input.tree[0]) || host::sleeps(d, input.tree[1]);
  };
  contacts.erase(std::remove_if(contacts.begin(), contacts.end(), rests), contacts.end());
  constraints.erase(std::remove_if(constraints.begin(), constraints.end(), rests),
                    constraints.end());
}

const std::vector<int>& SleepingTrees::find_falling(mjData_* d, const SolvedSubstep& substep,
                                                    const std::vector<Island>& islands,
                                                    const host::MocapMotion& mocap,
                                                    const std::vector<double>& recovered) {
  island_of_.assign(substep.motion.tree_count(), -1);
  for (size_t i = 0; i < islands.size(); ++i)
    for (int tree : islands[i].tree) island_of_[tree] = static_cast<int>(i);
  find_driven(substep, mocap);
  recovery_speed_ = recovered;
  for (double& speed : recovery_speed_) speed /= substep.length;
  falling_ = host::find_falling_asleep(substep.model, d, island_of_, driven_, recovery_speed_);
  return falling_;
}

// Finds which trees mocap bodies that move touch or hold.
void SleepingTrees::find_driven(const SolvedSubstep& substep, const host::MocapMotion& mocap) {
  driven_.assign(substep.motion.tree_count(), 0);
  const auto drive = [&](const std::array<int, 2>& trees) {
    for (int tree : trees)
      if (tree >= 0) driven_[tree] = 1;
  };
  for (const ContactInput& contact : substep.contacts)
    if (mocap.moves(contact.geom[0]) || mocap.moves(contact.geom[1])) drive(contact.tree);
  for (const ConstraintInput& constraint : substep.constraints)
    if (constraint.drive != 0.0) drive(constraint.tree);
}

void SleepingTrees::put_to_sleep(mjModel_* m, mjData_* d) const {
  host::put_to_sleep(m, d, falling_, island_of_);
}

}  // namespace dashpot
