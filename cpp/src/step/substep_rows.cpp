// The rows of a substep: how they are built, planned and solved.

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/model/checks.hpp"
#include "dashpot/rows/recall.hpp"
#include "dashpot/solve/position_recovery.hpp"
#include "row_assembly.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

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
  stats.islands = static_cast<int>(plan.islands().size());
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

void Stepper::Impl::build_rows(mjData_* d) {
  act_along_in_links(d);
  assemble_rows(model, d, parameters, constraints, contacts, row_turns, motion, rows, materials,
                team);
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
  matching.find(memory(d), contacts, rows, matches, team);
  const StepView step = view(d);
  accounting.open(step.memory, sleeping.rows());
  trapezoid.finish_last_step(d, step, differentiable, motion, rows, data, accounting.ledger());
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  const StepView step = view(d);
  const double recovery_speed = parameters.options.recovery_speed;
  plan.find(model, step, motion.trees(), parameters.options, resolved_length(), hit_frequency(),
            rows, materials, data, team);
  recall(step, rows, recovery_speed, data, team);
  if (!substep.impact.empty() && !std::isinf(recovery_speed))
    limit_compression(step, substep.impact, rows, data);
}

void Stepper::Impl::run_islands(mjData_* d) {
  const EnergyShares before = elastic_energy(rows, data, team);
  microsteps.run(rows, motion.trees(), plan.islands(), motion.linked(),
                 parameters.options.recovery_speed, clock.length, data, team);
  check_velocities();
  find_touched_trees();
  check_memory(d);
  EnergyLedger& ledger = accounting.ledger();
  book_rows(data, before, elastic_energy(rows, data, team), ledger);
  recovery.assign(motion.trees().coordinates, 0.0);
  for (const Island& island : plan.islands()) {
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

}  // namespace dashpot
