// How far a substep goes. Its length is proposed by what is known before it is solved: how
// far trees turn (integrate/turning_substeps.hpp) and, with impact="cut", where an impact begins
// (impacts/impact.hpp). What is solved is taken anew where that shows it to be too long: trees are
// thrown about, or equalities turn far; or where it comes to contacts that detection did not know
// of (impacts/impact_propagation.hpp).

#include <algorithm>

#include "dashpot/integrate/turning_substeps.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Times that a substep is taken anew for its impacts: bodies that a blow runs through in a step.
constexpr int kMostPropagations = 16;

constexpr int kTreesAtOnce = 64;  // by a thread

}  // namespace

// Solves the rows of the longest substep that they hold for.
void Stepper::Impl::solve_substep(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap) {
  if (shorten(length_of_turns(d), substeps))
    motion.find_smooth_motion(d, clock.length, is_rough(substeps), data, team);
  detect_and_solve(d, substeps, mocap);
  propagate_impacts(d, mocap);
  while (shorten(length_of_what_came(), substeps)) {
    motion.find_smooth_motion(d, clock.length, is_rough(substeps), data, team);
    detect_and_solve(d, substeps, mocap);
    propagate_impacts(d, mocap);
  }
}

// Up to where trees have turned as far as steps follow, or equalities, at their rate in the substep
// before, as far as their rows do.
double Stepper::Impl::length_of_turns(mjData_* d) {
  const double* const held = memory(d).held_motion().held;
  return std::min(substep_of_smooth_turn(model, d, motion, held, clock),
                  substep_of_turning_rows(clock.row_turn_rate * clock.length, clock));
}

// Up to where the trees that rows have thrown about do, or equalities. The rate of these is kept
// for the next substep, in which they most often go on so.
double Stepper::Impl::length_of_what_came() {
  const double thrown = substep_of_thrown_turn(model, motion, data, on_trees.touched, clock);
  if (thrown < clock.length) return thrown;
  const double turn = trapezoid.fastest_turn();
  clock.row_turn_rate = turn / clock.length;
  return substep_of_turning_rows(turn, clock);
}

bool Stepper::Impl::shorten(double shorter, host::Substeps& substeps) {
  if (shorter == clock.length) return false;
  clock.length = shorter;
  substeps.set_length(clock.length);
  detection.narrowphase.forget();  // for collisions look as far ahead as the substep is long
  return true;
}

void Stepper::Impl::detect_and_solve(mjData_* d, host::Substeps& substeps,
                                     host::MocapMotion& mocap) {
  const bool rough = is_rough(substeps);
  const double searched = clock.length;
  clock.cut_short = false;
  mocap.shorten(clock.length);
  detect(d, mocap);
  if (parameters.options.impact == Impact::kCut) cut_at_impact(d, substeps);
  mocap.shorten(clock.length);
  if (rough || clock.length != searched)
    motion.find_smooth_motion(d, clock.length, false, data, team);
  solve(d, mocap);
}

// Whether the smooth motion may be rough: a substep that another will follow needs no more than
// directions for the search of its end.
bool Stepper::Impl::is_rough(const host::Substeps& substeps) const {
  return parameters.options.impact == Impact::kCut && substeps.cut() && clock.cuts < kMaxCuts;
}

// Ends this substep where the next impact begins.
void Stepper::Impl::cut_at_impact(mjData_* d, host::Substeps& substeps) {
  substep = substep_before_impact(model, d, memory(d), motion.smooth_acceleration(), constraints,
                                  contacts, clock);
  drop_pairs(substep.apart, contacts);
  clock.cut_short = shorten(substep.length, substeps);
}

// Takes the substep anew while its impacts bring about more contacts.
void Stepper::Impl::propagate_impacts(mjData_* d, host::MocapMotion& mocap) {
  // Nothing that no row touched has another way than the smooth motion that detection went by.
  const auto any_touched = [&] {
    const std::vector<char>& touched = on_trees.touched;
    return std::find(touched.begin(), touched.end(), 1) != touched.end();
  };
  for (int turn = 0; turn < kMostPropagations && any_touched(); ++turn) {
    find_mean_velocity();
    if (!propagation.comes_to_more(model, d, mean_velocity, clock.length, contacts, end_gap,
                                   detection.narrowing.pairs(), detection.buffers))
      return;
    const size_t known = contacts.size() + constraints.size();
    motion.find_smooth_motion(d, clock.length, false, data, team);
    do {
      host::detect_rows(model, d, motion.smooth_acceleration(), detection, contacts, constraints,
                        team);
      mocap.drive(constraints);
    } while (wake_reached(d, mocap));
    sleeping.leave_out(model, d, contacts, constraints);
    correct_contacts_ahead(d);
    drop_pairs(substep.apart, contacts);
    mocap.drive(contacts);
    solve(d, mocap);
    if (contacts.size() + constraints.size() == known) return;
  }
}

// Trees that rows moved have the mean velocity of micro-steps, all others that of smooth motion.
void Stepper::Impl::find_mean_velocity() {
  mean_velocity = motion.start_velocity();
  for (size_t i = 0; i < mean_velocity.size(); ++i)
    mean_velocity[i] += 0.5 * clock.length * motion.smooth_acceleration()[i];
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    double* mean = mean_velocity.data() + tree.dof_begin;
    if (!on_trees.touched[index]) return;
    motion.to_generalized(index, data.total_displacement.data() + tree.begin, mean);
    for (int i = 0; i < tree.dof_count; ++i) mean[i] /= clock.length;
  });
}

}  // namespace dashpot
