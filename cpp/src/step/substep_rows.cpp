// The rows of a substep: how they are built, in which geometry, planned and solved. They have the
// geometry of the middle of the step where bodies touch and turn (detect/turning.hpp), of the
// middle of the substep where an impact has cut it (impact.hpp).

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/detect/turning.hpp"
#include "dashpot/islands/contact_matching.hpp"
#include "dashpot/islands/island_hits.hpp"
#include "dashpot/islands/modal_damping.hpp"
#include "dashpot/islands/solref_load.hpp"
#include "dashpot/islands/static_deflection_limits.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/rows/recall.hpp"
#include "dashpot/solve/position_recovery.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Micro-step (s) that rigid contacts are as stiff for.
double rigid_microstep(const Options& options, double length) {
  double count = options.microsteps;
  if (options.microsteps == 0)
    count = std::max<double>(kMinimumMicrosteps, std::ceil(length / kRigidMicrostep));
  const int of_step = static_cast<int>(std::min<double>(count, options.max_microsteps));
  return length / microsteps_of_hit(of_step, options).stiff_for;
}

}  // namespace

// Builds the rows of the substep, and finishes the last step once they are known.
void Stepper::Impl::find_rows(mjData_* d, host::MocapMotion& mocap) {
  geometry_of_middle = !substep.impact.empty();
  tree_ahead.assign(motion.tree_count(), 0.0);
  if (geometry_of_middle) {
    build_rows_in_the_middle(d, substep.apart, mocap);
    give_rigid_impacts_springs(memory(d), substep.impact, contacts, rows, clock.length, materials);
  } else {
    freeze_within_step(d);
    build_rows(d);
  }
  finish_last_step(d);
}

// Builds the rows of the substep, and finds what they do in it.
void Stepper::Impl::solve(mjData_* d, host::MocapMotion& mocap) {
  find_rows(d, mocap);
  stats = StepStats();
  act(d);
  find_end_of_contacts();
}

void Stepper::Impl::act(mjData_* d) {
  plan_and_recall(d);
  run_islands(d);
}

// A gap at the end of the step is where the surfaces are, not what the spring is compressed by: the
// two differ by the unstressed penetration.
void Stepper::Impl::find_end_of_contacts() {
  stats.contacts = static_cast<int>(contacts.size());
  stats.islands = static_cast<int>(islands.all().size());
  end_gap.resize(contacts.size());
  compressed.clear();
  for (size_t i = constraints.size(); i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    const double deformation = data.deformation[c.row];
    end_gap[c.input] = deformation - data.unstressed[i];
    if (deformation < 0.0) compressed.push_back(static_cast<int>(i));
    stats.touching += data.touched[i];
    stats.max_penetration = std::max(stats.max_penetration, -contacts[c.input].gap);
    stats.max_compression = std::max(stats.max_compression, -deformation);
  }
}

void Stepper::Impl::freeze_within_step(mjData_* d) {
  freeze_turning_contacts(d);
  row_turns.forget();
  row_turns.find(model, d, clock.length, motion.trees(), data.velocity.data(), constraints);
}

// Lets dampers and springs act in the micro-steps of linked trees.
void Stepper::Impl::act_along_in_links(mjData_* d) {
  const double* const held = memory(d).held_motion().held;
  for (int tree = 0; tree < motion.tree_count(); ++tree) {
    if (!motion.linked()[tree]) continue;
    motion.spring_in_microsteps(tree);
    motion.damp_in_microsteps(d, tree, held[tree] != 0.0);
    motion.invert_inertia(d, tree);
  }
}

void Stepper::Impl::finish_last_step(mjData_* d) {
  match_contacts(memory(d), contacts, rows, matches, team);
  const StepView step = view(d);
  accounting.open(step.memory, sleeping.rows());
  trapezoid.finish_last_step(d, step, differentiable, motion, rows, data, accounting.ledger());
}

// Finds which islands the rows form, what hits, presses or stays open in them, and from that their
// stiffness and micro-steps. Materials are read at the load that rows bear.
void Stepper::Impl::plan_rows(const StepView& step) {
  const Trees& trees = motion.trees();
  islands.find(rows, trees);
  if (read_solref_at_load(step, data.velocity, rows, materials))
    damp_clamped_bodies(model, contacts, rows, materials);
  find_deflection_times(model, step, rows, data.velocity, team, deflection_times);
  find_hits(step, rows, islands.all(), hit_frequency(), data);
  find_inactive_contacts(step, rows, islands.all(), motion.tree_count(), data, stays_open);
  damp_modes(model, materials, contacts, trees, stays_open, data, clock.length, rows, compression);
  tied_mass.find(step, materials, trees, islands.all(), compression, data, rows);
  islands.plan(rows, trees,
               {materials, deflection_times, stays_open, data, clock.length, resolved_length(),
                parameters.options},
               team);
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  const StepView step = view(d);
  const double recovery_speed = parameters.options.recovery_speed;
  plan_rows(step);
  recall(step, rows, recovery_speed, data, team);
  if (!substep.impact.empty() && !std::isinf(recovery_speed))
    limit_compression(step, substep.impact, rows, data);
}

void Stepper::Impl::run_islands(mjData_* d) {
  const EnergyShares before = elastic_energy(rows, data, team);
  microsteps.run(rows, motion.trees(), islands.all(), motion.linked(),
                 parameters.options.recovery_speed, clock.length, data, team);
  check_velocities();
  find_touched_trees();
  check_memory(d);
  EnergyLedger& ledger = accounting.ledger();
  book_rows(data, before, elastic_energy(rows, data, team), ledger);
  recovery.assign(motion.trees().coordinates, 0.0);
  for (const Island& island : islands.all()) {
    stats.microsteps = std::max(stats.microsteps, island.microsteps);
    stats.clipped += island.clipped;
    const double strained =
        recover_positions(rows, motion.trees(), island, parameters.options.recovery_speed,
                          clock.length, data, recovery);
    ledger.dissipated_recovery -= strained;
    ledger.elastic += strained;
  }
  for (int i = 0; i < motion.trees().coordinates; ++i) data.total_displacement[i] += recovery[i];
}

void Stepper::Impl::check_velocities() const {
  for (const Tree& tree : motion.trees().tree)
    check_bounded(tree, data.velocity.data(), host::kLargestValue);
}

// Throws before anything is changed: what is compressed has to be remembered.
void Stepper::Impl::check_memory(mjData_* d) const {
  const auto remembered = to_remember + memory(d).count(sleeping.rows());
  if (remembered > memory_layout.contacts)
    throw std::runtime_error(std::to_string(remembered) + " contacts exceed the memory for " +
                             std::to_string(memory_layout.contacts) +
                             " contacts that data reserve: make the engine of a model whose geoms "
                             "may touch as they do now");
}

StepView Stepper::Impl::view(mjData_* d) const {
  return {clock.length, contacts, constraints, memory(d), matches};
}

SolvedSubstep Stepper::Impl::solved_substep() const {
  return {model, clock.length, contacts, constraints, rows,
          data,  on_trees,     recovery, motion,      trapezoid};
}

// Length (s) of the step that stiffness is resolved for: cuts at impacts let it be finer.
double Stepper::Impl::resolved_length() const {
  return parameters.options.impact == Impact::kCut ? clock.length : clock.whole;
}

// Of a rigid contact what micro-steps resolve of one alone; several on one body are softer.
HitFrequency Stepper::Impl::hit_frequency() const {
  const double rigid =
      std::sqrt(kStiffestAlone) / rigid_microstep(parameters.options, resolved_length());
  return [this, rigid](const ContactInput& contact, double inverse_mass) {
    const GroupMaterial given = material_of(model, parameters, contact, host::usual_gravity(model));
    if (given.from_solref) return std::min(rigid, std::sqrt(given.normalised_stiffness));
    if (given.is_rigid()) return rigid;
    return std::min(rigid, std::sqrt(given.material.stiffness * inverse_mass));
  };
}

// Contacts of bodies that turn are frozen where their forces act. The inertia of a free body goes
// there too, unless constraints hold it, which are those of the start.
void Stepper::Impl::freeze_turning_contacts(mjData_* d) {
  const HitFrequency frequency = hit_frequency();
  const Memory view = memory(d);
  host::freeze_contacts(
      model, d,
      {clock.length, differentiable, motion.trees(), data.velocity.data(), frequency, view},
      detection.faces, detection.scratch, contacts, tree_ahead, team);
  for (const ConstraintInput& constraint : constraints)
    for (int tree : constraint.tree)
      if (tree >= 0) tree_ahead[tree] = 0.0;
  for (int tree = 0; tree < motion.tree_count(); ++tree) {
    if (!motion.can_freeze_ahead(tree)) tree_ahead[tree] = 0.0;
    if (tree_ahead[tree] > 0.0) motion.freeze_ahead(tree, tree_ahead[tree]);
  }
}

void Stepper::Impl::build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart,
                                             host::MocapMotion& mocap) {
  const std::vector<ConstraintInput> start_constraints = constraints;
  mocap.show(0.5 * clock.length);
  host::MiddleGeometry middle(model, d, motion.smooth_acceleration(), detection, contacts,
                              constraints, team);
  sleeping.leave_out(model, d, contacts, constraints);
  drop_pairs(apart, contacts);
  drop_pairs(flights.near_misses(), contacts);
  mocap.drive(constraints);
  mocap.drive(contacts);
  motion.freeze_at_middle(d, clock.length, data, team);
  row_turns.forget();
  build_rows(d);
  give_back_way(rows, data, clock.length, start_constraints, contacts, constraints);
  mocap.show(0.0);
  middle.leave();
}

}  // namespace dashpot
