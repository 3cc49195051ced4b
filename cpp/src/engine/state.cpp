// The forces of a part and how the state follows: trees that rows moved go as in the micro-steps,
// all others as MuJoCo's integrator takes them.

#include "dashpot/mujoco/state.hpp"

#include "dashpot/mujoco/host.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 16;  // by a thread

}  // namespace

void Stepper::Impl::find_touched_trees() {
  on_trees.reset(motion.tree_count());
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    const bool recovers = c.kind == RowKind::kBilateral && data.offset[i] != 0.0;
    if (!data.touched[i] && !recovers && !lands_in_next_step(c)) continue;
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

// What the last step left in time near rows that have a position goes on so, by micro-steps, until
// it leads or lands. MuJoCo's integrator would take its positions half a step ahead.
void Stepper::Impl::find_trees_in_time() {
  goes_in_time.assign(motion.tree_count(), 0);
  for (const Island& island : plan.islands()) {
    for (int tree : island.tree) goes_in_time[tree] = leapfrog.in_time()[tree] && may_be_held[tree];
  }
}

// Where the semi-implicit update would take a tree into an overlap that its motion does not have,
// it takes the motion of the micro-steps: otherwise a tree at rest is thrown back by the recovery
// of that overlap, step after step. No micro-steps move what only groups of no island reach.
bool Stepper::Impl::lands_in_next_step(const RowGroup& c) const {
  if (parameters.options.law == Law::kComFree || !c.can_be_loaded) return false;
  const double gap =
      c.kind == RowKind::kContact ? contacts[c.input].gap : constraints[c.input].position;
  return overlaps_semi_implicitly(rows, c, gap, velocity_before, data.smooth_acceleration,
                                  clock.length);
}

RowsOnTree Stepper::Impl::rows_on_tree(int tree) const {
  RowsOnTree by_rows;
  by_rows.touched = on_trees.touched[tree];
  by_rows.joined = on_trees.joined[tree];
  by_rows.held = on_trees.held[tree];
  by_rows.frozen_ahead = geometry_of_middle || tree_ahead[tree] > 0.0;
  by_rows.trapezoidal = trapezoid.holds(tree);
  by_rows.unpaid = on_trees.unpaid[tree];
  by_rows.added_velocity = trapezoid.added_velocity();
  return by_rows;
}

// Whether rows move all trees but free bodies, which move accurately in any case: MuJoCo's
// integrator has none to move then.
bool Stepper::Impl::rows_move_all() const {
  if (parameters.options.law == Law::kComFree) return false;
  const bool stages = host::is_runge_kutta(model);
  if (stages && (host::others_look_at_stages(model) || host::has_activations(model))) return false;
  for (int tree = 0; tree < motion.tree_count(); ++tree) {
    const bool by_rows = stages ? on_trees.held[tree] : on_trees.touched[tree];
    if (!by_rows && (!motion.is_accurate(tree) || (stages && motion.is_sprung(tree)))) return false;
  }
  return true;
}

void Stepper::Impl::add_second_halves_in_flight(mjData_* d) {
  const SolvedPart solved = solved_part();
  for (int index = 0; index < motion.tree_count(); ++index)
    if (solved.gets_second_half_in_flight(index))
      motion.add_velocity(d, index, trapezoid.added_velocity());
}

// Under those of the micro-steps MuJoCo's integrator moves trees.
void Stepper::Impl::find_forces(mjData_* d) {
  const SolvedPart solved = solved_part();
  forces.start(rows);
  trapezoid.add_borne(forces.borne());
  const bool looked_at = detection.contact_rows != host::ContactRows::kNone;
  if (looked_at) forces.leave_out_untouched(d, solved, contacts);
  forces.find(d, solved, team);
}

// Of RK4. Who looks at its stages sees the sensors of the step there.
void Stepper::Impl::find_stages(mjData_* d, bool new_control) {
  has_stages = host::is_runge_kutta(model) && !rows_move_all();
  if (!has_stages) return;
  if (host::others_look_at_stages(model)) forces.report(d, solved_part());
  add_second_halves_in_flight(d);
  find_held_acceleration();
  try {
    runge_kutta.find_motion(model, d, new_control, held_acceleration, find_contacts);
  } catch (...) {
    host::set_velocity(d, motion.start_velocity());
    throw;
  }
  host::set_velocity(d, motion.start_velocity());
}

// Of trees that rows hold, and that the stages do not move: NaN of others.
void Stepper::Impl::find_held_acceleration() {
  held_acceleration.assign(motion.start_velocity().size(),
                           std::numeric_limits<double>::quiet_NaN());
  if (parameters.options.law == Law::kComFree) return;
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& tree = motion.trees().tree[index];
    if (!on_trees.held[index] || motion.is_accurate(index)) continue;
    for (int i = 0; i < tree.dof_count; ++i) {
      const int k = tree.begin + i;
      held_acceleration[tree.dof_begin + i] =
          (data.velocity[k] - data.start_motion[k]) / clock.length;
    }
  }
}

// Decides which trees have their motion from the integrator of MuJoCo.
void Stepper::Impl::find_integrated(mjData_* d) {
  books.find_unpaid(memory(d), solved_part(), on_trees.unpaid);
  for (int index = 0; index < motion.tree_count(); ++index)
    if (!motion.is_accurate(index)) motion.find_integrated(index, rows_on_tree(index));
}

void Stepper::Impl::report_forces(mjData_* d) {
  const SolvedPart solved = solved_part();
  if (parameters.options.law != Law::kComFree) {
    find_integrated(d);
    forces.find_reported(d, solved);
  }
  const bool reported = has_stages && host::others_look_at_stages(model);
  if (!reported || forces.report_others()) forces.report(d, solved);
}

// The complementarity-free law asks for contacts at the end of a step that goes all the way with
// its velocity there, as other integrators of MuJoCo do.
void Stepper::Impl::advance_state(mjData_* d) {
  const bool comfree = parameters.options.law == Law::kComFree;
  if (forces.report_others()) forces.exchange(d);
  if (!has_stages) add_second_halves_in_flight(d);
  try {
    host::integrate(model, d, comfree || !rows_move_all(), runge_kutta);
  } catch (...) {
    host::set_velocity(d, motion.start_velocity());
    throw;
  }
  if (forces.report_others()) forces.exchange(d);
  if (comfree && !has_stages) return;
  on_trees.lost.resize(motion.tree_count());
  const auto advance = [&](int index) {
    on_trees.lost[index] = motion.advance(d, index, clock.length, rows_on_tree(index), data);
  };
  if (!comfree)
    team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
      if (motion.is_accurate(index)) advance(index);
    });
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (comfree) {
      if (on_trees.touched[index]) motion.advance_semi_implicitly(d, index, clock.length);
      continue;
    }
    if (!motion.is_accurate(index)) advance(index);
    books.ledger().dissipated_normal += on_trees.lost[index];
    if (const double* way = leapfrog.late_way(index)) {
      const Tree& tree = motion.trees().tree[index];
      host::move_tree(model, d, tree, way + tree.begin);
    }
  }
}

}  // namespace dashpot
