// Steps whose impacts bring about contacts that detection did not know of, see knock_on.hpp.

#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Times that a step is taken anew for what its impacts bring about: bodies that a blow runs through
// within one step, at most.
constexpr int kMostTurns = 16;

}  // namespace

// Takes the part of the step anew while its impacts bring about more contacts.
void Stepper::Impl::follow_knock_on(mjData_* d, host::MocapMotion& mocap) {
  if (parameters.options.law == Law::kComFree) return;
  for (int turn = 0; turn < kMostTurns && goes_beyond_detection(); ++turn) {
    mean_motion.find(solved_part(), team);
    if (!knock_on.comes_to_more(model, d, mean_motion.velocity(), clock.length, contacts,
                                mean_motion.end_gap(), detection.narrowing.pairs(),
                                detection.buffers))
      return;
    const size_t known = contacts.size() + constraints.size();
    motion.find_smooth_motion(d, clock.length, false, data, team);
    do {
      host::detect_again(model, d, motion.smooth_acceleration(), knock_on.body_velocity(),
                         detection, contacts, constraints, team);
      mocap.drive(constraints);
    } while (wake_reached(d, mocap));
    sleeping.leave_out(model, d, contacts, constraints);
    correct_contacts_ahead(d);
    drop_pairs(part.apart, contacts);
    mocap.drive(contacts);
    solve(d, mocap);
    if (contacts.size() + constraints.size() == known) return;
  }
}

// Whether anything has another way than the smooth motion that detection went by.
bool Stepper::Impl::goes_beyond_detection() const {
  for (int tree = 0; tree < motion.tree_count(); ++tree)
    if (on_trees.touched[tree]) return true;
  return false;
}

}  // namespace dashpot
