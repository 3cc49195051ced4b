// Trees that sleep (mujoco/sleep.hpp): what wakes them in a step, and which fall asleep at its end.

#include "dashpot/mujoco/sleep.hpp"

#include <algorithm>

#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/host.hpp"
#include "dashpot/mujoco/state.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

// Wakes what rows join to trees that are awake, or to mocap bodies that move, and finds how that
// moves; returns whether there was any.
bool Stepper::Impl::wake_reached(mjData_* d, const host::MocapMotion& mocap) {
  if (!host::any_sleeps(model, d)) return false;
  bool any = false;
  const auto wake = [&](const std::array<int, 2>& trees, bool is_driven) {
    for (int side = 0; side < 2; ++side) {
      const int tree = trees[side], other = trees[1 - side];
      if (!host::sleeps(d, tree) || !(is_driven || (other >= 0 && !host::sleeps(d, other))))
        continue;
      host::wake(model, d, tree);
      any = true;
    }
  };
  for (const ContactInput& contact : contacts)
    wake(contact.tree, mocap.moves(contact.geom[0]) || mocap.moves(contact.geom[1]));
  for (const ConstraintInput& constraint : constraints)
    wake(constraint.tree, constraint.drive != 0.0);
  if (!any) return false;
  host::smooth_stage(model, d, false, host::Sensors::kStay, find_contacts);
  mocap.write_velocities();
  motion.find_smooth_motion(d, clock.length, false, data, team);
  return true;
}

// What sleeps has no rows, nor on mocap bodies that stay where they are.
void Stepper::Impl::leave_asleep(const mjData_* d) {
  host::find_sleeping_rows(model, d, sleeping);
  if (!host::any_sleeps(model, d)) return;
  const auto rests = [&](const auto& input) {
    return host::sleeps(d, input.tree[0]) || host::sleeps(d, input.tree[1]);
  };
  contacts.erase(std::remove_if(contacts.begin(), contacts.end(), rests), contacts.end());
  constraints.erase(std::remove_if(constraints.begin(), constraints.end(), rests),
                    constraints.end());
}

// By tree, the number of its island, and whether mocap bodies that move touch it or hold it.
void Stepper::Impl::find_sleeping_islands(const host::MocapMotion& mocap) {
  island_of.assign(motion.tree_count(), -1);
  driven.assign(motion.tree_count(), 0);
  for (size_t i = 0; i < islands.all().size(); ++i)
    for (int tree : islands.all()[i].tree) island_of[tree] = static_cast<int>(i);
  const auto drive = [&](const std::array<int, 2>& trees) {
    for (int tree : trees)
      if (tree >= 0) driven[tree] = 1;
  };
  for (const ContactInput& contact : contacts)
    if (mocap.moves(contact.geom[0]) || mocap.moves(contact.geom[1])) drive(contact.tree);
  for (const ConstraintInput& constraint : constraints)
    if (constraint.drive != 0.0) drive(constraint.tree);
}

// Puts islands to sleep that have come to rest. Their kinetic energy is booked, and what memory
// keeps of their motion is forgotten.
void Stepper::Impl::fall_asleep(mjData_* d, const host::MocapMotion& mocap) {
  if (!host::may_sleep(model)) return;
  find_sleeping_islands(mocap);
  for (double& shift : ways.recovered) shift /= clock.length;
  const std::vector<int> falling =
      host::find_falling_asleep(model, d, island_of, driven, ways.recovered);
  if (falling.empty()) return;
  std::vector<double> velocity(motion.start_velocity().size()), momentum(velocity.size());
  for (int index : falling) {
    const Tree& tree = motion.trees().tree[index];
    std::copy_n(host::velocity(d) + tree.dof_begin, tree.dof_count,
                velocity.begin() + tree.dof_begin);
  }
  host::times_inertia(model, d, velocity.data(), momentum.data());
  for (size_t i = 0; i < velocity.size(); ++i)
    ledger.dissipated_damping += 0.5 * velocity[i] * momentum[i];
  Memory view = memory(d);
  view.set_ledger(ledger);
  host::put_to_sleep(model, d, falling, island_of);
  for (int index : falling) view.rest(motion.trees().tree[index], index);
}

}  // namespace dashpot
