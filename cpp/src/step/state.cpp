// The forces of a substep and how the state follows: trees that rows moved go as in the
// micro-steps, and so do links in flight.

#include "dashpot/model/state.hpp"

#include "dashpot/model/host.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 16;  // by a thread

}  // namespace

void Stepper::Impl::find_touched_trees() {
  on_trees.reset(motion.tree_count());
  to_remember = 0;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    to_remember += c.kind == RowKind::kContact && data.deformation[c.row] < 0.0;
    const bool recovers = c.kind == RowKind::kBilateral && data.unstressed[i] != 0.0;
    if (!data.touched[i] && !recovers) continue;
    for (int tree : c.tree) {
      if (tree < 0) continue;
      on_trees.touched[tree] = 1;
      if (c.tree[0] >= 0 && c.tree[1] >= 0) {
        on_trees.joined[tree] = 1;
      }
      on_trees.held[tree] |= c.kind != RowKind::kSlider;
    }
  }
}

RowsOnTree Stepper::Impl::rows_on_tree(int tree) const {
  RowsOnTree by_rows;
  by_rows.touched = on_trees.touched[tree];
  by_rows.joined = on_trees.joined[tree];
  by_rows.frozen_ahead = geometry_of_middle || tree_ahead[tree] > 0.0;
  by_rows.trapezoidal = trapezoid.holds(tree);
  by_rows.unpaid = on_trees.unpaid[tree];
  return by_rows;
}

// Under those of the micro-steps MuJoCo's integrator goes on.
void Stepper::Impl::find_forces(mjData_* d) {
  const SolvedSubstep solved = solved_substep();
  forces.start(rows);
  const bool looked_at = detection.contact_rows != host::ContactRows::kNone;
  if (looked_at || host::callbacks_may_read()) trapezoid.add_borne(forces.borne());
  if (looked_at) forces.leave_out_untouched(d, solved, contacts);
  forces.find(d, solved, team);
}

void Stepper::Impl::report_forces(mjData_* d) {
  const SolvedSubstep solved = solved_substep();
  accounting.find_unpaid(memory(d), solved, on_trees.unpaid);
  forces.find_reported(d, solved);
  forces.report(d, solved);
}

// Activations, plugins, and trees that are MuJoCo's to move.
void Stepper::Impl::integrate_by_mujoco(mjData_* d) {
  if (forces.report_others()) forces.exchange(d);
  try {
    host::integrate(model, d, motion.any_by_mujoco(), may_have_rows);
  } catch (...) {
    host::set_velocity(d, motion.start_velocity());
    throw;
  }
  if (forces.report_others()) forces.exchange(d);
}

void Stepper::Impl::advance_state(mjData_* d) {
  integrate_by_mujoco(d);
  on_trees.lost.resize(motion.tree_count());
  const auto advance = [&](int index) {
    on_trees.lost[index] = motion.advance(d, index, clock.length, rows_on_tree(index), data);
  };
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    if (motion.is_accurate(index)) advance(index);
  });
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!motion.is_accurate(index)) advance(index);
    accounting.ledger().dissipated_normal += on_trees.lost[index];
  }
}

}  // namespace dashpot
