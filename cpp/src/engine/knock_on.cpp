// Steps whose impacts bring about contacts that detection did not know of, see knock_on.hpp.

#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Times that a step is taken anew for what its impacts bring about: bodies that a blow runs through
// within one step, at most.
constexpr int kMostTurns = 16;
constexpr int kTreesAtOnce = 64;  // by a thread

}  // namespace

// Takes the part of the step anew while its impacts bring about more contacts.
void Stepper::Impl::follow_knock_on(mjData_* d, host::MocapMotion& mocap) {
  if (parameters.options.law == Law::kComFree) return;
  for (int turn = 0; turn < kMostTurns && goes_beyond_detection(); ++turn) {
    find_mean_velocity();
    find_end_gaps();
    if (!knock_on.comes_to_more(model, d, mean_motion.velocity, clock.length, contacts,
                                mean_motion.end_gap, detection.narrowing.pairs(),
                                detection.buffers))
      return;
    const size_t known = contacts.size() + constraints.size();
    motion.find_smooth_motion(d, clock.length, false, data, team);
    do {
      host::detect_again(model, d, motion.smooth_acceleration(), knock_on.body_velocity(),
                         detection, contacts, constraints, team);
      mocap.drive(constraints);
    } while (wake_reached(d, mocap));
    leave_asleep(d);
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
    if (on_trees.touched[tree] || leapfrog.late_way(tree)) return true;
  return false;
}

// Trees that rows moved have the mean velocity of their micro-steps, all others that of the smooth
// motion and of what they go ahead by (leapfrog.hpp).
void Stepper::Impl::find_mean_velocity() {
  const std::vector<double>& start = motion.start_velocity();
  mean_motion.velocity = start;
  for (size_t i = 0; i < start.size(); ++i)
    mean_motion.velocity[i] += 0.5 * clock.length * motion.smooth_acceleration()[i];
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    double* mean = mean_motion.velocity.data() + tree.dof_begin;
    if (const double* way = leapfrog.late_way(index))
      for (int i = 0; i < tree.dof_count; ++i) mean[i] += way[tree.begin + i] / clock.length;
    if (!on_trees.touched[index]) return;
    motion.to_generalized(index, data.total_displacement.data() + tree.begin, mean);
    for (int i = 0; i < tree.dof_count; ++i) mean[i] /= clock.length;
  });
}

// A gap at the end of the step is where the surfaces are, not what the spring is compressed by: the
// two differ by the unstressed offset.
void Stepper::Impl::find_end_gaps() {
  mean_motion.end_gap.resize(contacts.size());
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kContact)
      mean_motion.end_gap[c.input] = data.deformation[c.row] - data.offset[i];
  }
}

}  // namespace dashpot
