#include "mean_motion.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 64;  // by a thread

}  // namespace

void MeanMotion::find(const SolvedPart& part, Team& team) {
  find_velocity(part, team);
  find_end_gaps(part);
}

// Trees that rows moved have the mean velocity of their micro-steps, all others that of the smooth
// motion.
void MeanMotion::find_velocity(const SolvedPart& part, Team& team) {
  const TreeMotion& motion = part.motion;
  velocity_ = motion.start_velocity();
  for (size_t i = 0; i < velocity_.size(); ++i)
    velocity_[i] += 0.5 * part.length * motion.smooth_acceleration()[i];
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    double* mean = velocity_.data() + tree.dof_begin;
    if (!part.on_trees.touched[index]) return;
    motion.to_generalized(index, part.data.total_displacement.data() + tree.begin, mean);
    for (int i = 0; i < tree.dof_count; ++i) mean[i] /= part.length;
  });
}

// A gap at the end of the step is where the surfaces are, not what the spring is compressed by: the
// two differ by the unstressed offset.
void MeanMotion::find_end_gaps(const SolvedPart& part) {
  end_gap_.resize(part.contacts.size());
  for (size_t i = 0; i < part.rows.group.size(); ++i) {
    const RowGroup& c = part.rows.group[i];
    if (c.kind == RowKind::kContact)
      end_gap_[c.input] = part.data.deformation[c.row] - part.data.offset[i];
  }
}

}  // namespace dashpot
