#include "dashpot/engine/engine.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/engine/row_assembly.hpp"
#include "dashpot/islands/solref_load.hpp"
#include "dashpot/microsteps/position_recovery.hpp"
#include "dashpot/mujoco/data_checks.hpp"
#include "dashpot/mujoco/errors.hpp"
#include "dashpot/mujoco/features.hpp"
#include "dashpot/mujoco/host.hpp"
#include "dashpot/mujoco/properties.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"
#include "dashpot/mujoco/state.hpp"
#include "dashpot/rows/recall.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Fraction of a step that its parts may leave of it because they are rounded.
constexpr double kSliverOfStep = 1e-9;

void accumulate(const StepStats& step, StepStats& total) {
  total.contacts = step.contacts;
  total.touching = step.touching;
  total.islands = step.islands;
  total.microsteps = std::max(total.microsteps, step.microsteps);
  total.clipped = std::max(total.clipped, step.clipped);
  total.max_penetration = std::max(total.max_penetration, step.max_penetration);
  total.max_compression = std::max(total.max_compression, step.max_compression);
  total.cuts += step.cuts;
  total.parts = std::max(total.parts, step.parts);
}

}  // namespace

Stepper::Impl::Impl(mjModel_* m, const Parameters& p, int threads)
    : team(threads),
      model(m),
      parameters(p),
      motion(m, p.options.law != Law::kComFree),
      trapezoid(m),
      runge_kutta(p.options.law == Law::kComFree) {
  host::check_supported(m, p.options.law);
  if (p.options.impact == Impact::kCut && p.options.law != Law::kKelvinVoigt)
    throw std::invalid_argument("only law kelvin_voigt cuts steps at impacts");
  if (p.options.impact == Impact::kCut && host::flex_count(m) > 0)
    throw std::invalid_argument("impact \"cut\" does not see flexes; use \"none\"");
  const int geoms = host::geom_count(m);
  if (static_cast<int>(p.geom_material.size()) != geoms)
    throw std::invalid_argument("geom_material has " + std::to_string(p.geom_material.size()) +
                                " entries; the model has " + std::to_string(geoms) + " geoms");
  detection.takes_faces = p.options.law != Law::kComFree;
  memory_layout = dashpot::memory_layout(m, p.contact_capacity);
  data_size = host::data_size(m);
}

// Takes a step, on several threads unless they are slower.
StepStats Stepper::Impl::step(mjData_* d, bool leave_rows) {
  if (team.size() == 1) return take_step(d, leave_rows);
  const auto start = std::chrono::steady_clock::now();
  team.begin(pace.shares());
  const StepStats stats = take_step(d, leave_rows);
  pace.note(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return stats;
}

StepStats Stepper::Impl::take_step(mjData_* d, bool leave_rows) {
  host::check_options(model, parameters.options.law);
  host::follow_edited_masses(model);
  host::check_data(model, d, data_size);
  memory(d).check();
  const host::ErrorGuard guard(d);
  const bool moves_mocap = parameters.options.law != Law::kComFree;
  host::MocapMotion mocap(model, d, moves_mocap, parameters.options.mocap_timeconst, memory(d),
                          mocap_buffers);
  host::StepParts parts(model, d);
  detection.contact_rows = host::anything_reads_rows(model) ? host::ContactRows::kRequired
                           : leave_rows                     ? host::ContactRows::kIfTheyFit
                                                            : host::ContactRows::kNone;
  proven_apart.clear();
  clock = StepClock();
  clock.whole = parts.whole();
  StepStats total;
  int taken = 0;
  for (double remaining = clock.whole; remaining > kSliverOfStep * clock.whole;
       remaining -= clock.length) {
    clock.length = clock.rest = remaining;
    if (parts.cut()) parts.set_length(clock.length);
    advance(d, parts, mocap);
    clock.cuts += clock.cut_short;
    parts.end_part();
    accumulate(statistics(), total);
    ++taken;
  }
  parts.finish();
  total.cuts = clock.cuts;
  total.parts = taken;
  return total;
}

void Stepper::Impl::advance(mjData_* d, host::StepParts& parts, host::MocapMotion& mocap) {
  const bool new_control = !parts.cut();
  start_part(d, new_control, host::Sensors::kForCallbacks, is_rough(parts), mocap);
  if (shorten_for_turns(parts))
    motion.find_smooth_motion(d, clock.length, is_rough(parts), data, team);
  detect_and_solve(d, parts, mocap);
  while (shorten_for_throws(parts) || shorten_for_rows(parts)) {
    motion.find_smooth_motion(d, clock.length, is_rough(parts), data, team);
    detect_and_solve(d, parts, mocap);
  }
  find_forces(d);
  find_stages(d, new_control);
  report_forces(d);
  advance_state(d);
  mocap.write_velocities();
  account_smooth_work(d);
  ledger.work += mocap.work_against_gravity(clock.length);
  mocap.advance(clock.length);
  remember(d, mocap);
  proven_apart.forget(on_trees.touched);
}

void Stepper::Impl::start_part(mjData_* d, bool new_control, host::Sensors sensors, bool rough,
                               host::MocapMotion& mocap) {
  motion.start(d);
  mocap.begin(clock.length);
  host::smooth_stage(model, d, new_control, sensors, find_contacts);
  mocap.write_velocities();
  motion.find_smooth_motion(d, clock.length, rough, data, team);
}

void Stepper::Impl::detect_and_solve(mjData_* d, host::StepParts& parts, host::MocapMotion& mocap) {
  const bool rough = is_rough(parts);
  const double searched = clock.length;
  clock.cut_short = false;
  detect(d, mocap);
  if (parameters.options.impact == Impact::kCut) cut_at_impact(d, parts);
  if (rough || clock.length != searched)
    motion.find_smooth_motion(d, clock.length, false, data, team);
  solve(d, mocap);
  follow_knock_on(d, mocap);
}

void Stepper::Impl::detect(mjData_* d, host::MocapMotion& mocap) {
  host::detect(model, d, motion.smooth_acceleration(), detection, contacts, constraints, team);
  mocap.drive(constraints);
  part = Part();
  correct_contacts_ahead(d);
}

// Whether the smooth motion may be rough: a part that another will follow needs no more than
// directions for the search of its end.
bool Stepper::Impl::is_rough(const host::StepParts& parts) const {
  return parameters.options.impact == Impact::kCut && parts.cut() && clock.cuts < kMaxCuts;
}

// Builds the rows of the part, and finishes the last step once they are known.
void Stepper::Impl::find_rows(mjData_* d, host::MocapMotion& mocap) {
  geometry_of_middle = !part.impact.empty();
  if (parameters.options.law != Law::kComFree) leapfrog.find_leads(model, memory(d), motion);
  tree_ahead.assign(motion.tree_count(), 0.0);
  if (geometry_of_middle) {
    build_rows_in_the_middle(d, part.apart, mocap);
    give_rigid_impacts_springs(memory(d), part.impact, contacts, rows, clock.length, materials);
  } else {
    freeze_turning_contacts(d);
    find_row_turns(d);
    build_rows(d);
  }
  if (parameters.options.law == Law::kComFree) return;
  matching.find(memory(d), contacts, rows, matches, team);
  finish_last_step(d);
}

// Builds the rows of the part, and finds what they do in it.
void Stepper::Impl::solve(mjData_* d, host::MocapMotion& mocap) {
  find_rows(d, mocap);
  if (parameters.options.law == Law::kComFree) {
    update_complementarity_free(d);
  } else {
    plan_and_recall(d);
    run_islands();
  }
}

// Corrects contacts of bodies in flight, which may meet elsewhere than found, or pass by. With the
// complementarity-free law contact does not start within a step.
void Stepper::Impl::correct_contacts_ahead(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  flights.follow(model, d, memory(d), detection.buffers, constraints, clock.length, contacts);
}

void Stepper::Impl::find_row_turns(mjData_* d) {
  row_turns.forget();
  if (parameters.options.law != Law::kComFree)
    row_turns.find(model, d, clock.length, motion.trees(), data.velocity.data(), constraints);
}

void Stepper::Impl::build_rows(mjData_* d) {
  damp_held_trees(d);
  assemble_rows(model, d, parameters, constraints, contacts, row_turns, motion, rows, materials,
                team);
}

// Lets dampers act in the micro-steps of trees that rows may hold. Dry friction has no position to
// keep, and leaves a tree the dampers of MuJoCo's integrator. What the last step left over was
// found with those of its micro-steps.
void Stepper::Impl::damp_held_trees(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  const HeldMotion before = memory(d).held_motion();
  if (!before.length) return;
  may_be_held.resize(motion.tree_count());
  for (int tree = 0; tree < motion.tree_count(); ++tree)
    may_be_held[tree] = before.length[tree] > 0.0;
  const auto hold = [&](const std::array<int, 2>& trees) {
    for (int tree : trees)
      if (tree >= 0) may_be_held[tree] = 1;
  };
  for (const ContactInput& contact : contacts) hold(contact.tree);
  for (const ConstraintInput& constraint : constraints)
    if (constraint.kind != RowKind::kSlider) hold(constraint.tree);
  for (int tree = 0; tree < motion.tree_count(); ++tree)
    if (may_be_held[tree]) motion.damp_in_microsteps(d, tree);
}

void Stepper::Impl::finish_last_step(mjData_* d) {
  const StepView step = view(d);
  ledger = step.memory.ledger();
  trapezoid.finish_last_step(d, step, differentiable, motion, rows, data, ledger);
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  islands.find(rows, motion.trees());
  const StepView step = view(d);
  const double recovery_speed = parameters.options.recovery_speed;
  read_solref_at_load(step, data.velocity.data(), rows, materials);
  pressed_between.find(model, contacts, rows, materials);
  sag_times.find(model, step, rows, data.velocity.data(), team);
  find_hits(step, rows, islands.all(), hit_frequency(), data);
  pressed_together.find(materials, contacts, motion.trees(), data, clock.length, rows);
  islands.plan(
      rows, motion.trees(),
      {materials, sag_times.of_group(), data, clock.length, resolved_length(), parameters.options},
      team);
  recall(step, rows, recovery_speed, data, team);
  if (!part.impact.empty() && !std::isinf(recovery_speed))
    limit_compression(step, part.impact, rows, data);
  leapfrog.fall_back(step.memory, motion, rows, data);
}

void Stepper::Impl::run_islands() {
  const EnergyShares before = elastic_energy(rows, data, team);
  velocity_before = data.velocity;
  microsteps.run(rows, motion.trees(), islands.all(), parameters.options.recovery_speed,
                 clock.length, data, team);
  check_velocities();
  check_memory();
  find_touched_trees();
  leapfrog.go_ahead(clock.length, on_trees.held, motion, rows, data);
  book_rows(data, before, elastic_energy(rows, data, team), ledger);
  if (host::is_runge_kutta(model)) ways.of_microsteps = data.total_displacement;
  ways.recovery.assign(motion.trees().coordinates, 0.0);
  for (const Island& island : islands.all()) {
    const double strained =
        recover_positions(rows, motion.trees(), island, parameters.options.recovery_speed,
                          clock.length, data, ways.recovery);
    ledger.dissipated_recovery -= strained;
    ledger.elastic += strained;
  }
  for (int i = 0; i < motion.trees().coordinates; ++i)
    data.total_displacement[i] += ways.recovery[i];
}

void Stepper::Impl::check_velocities() const {
  for (const Tree& tree : motion.trees().tree)
    check_bounded(tree, data.velocity.data(), host::kLargestValue);
}

// Throws before anything is changed: what is compressed has to be remembered.
void Stepper::Impl::check_memory() const {
  const auto compressed =
      std::count_if(rows.group.begin(), rows.group.end(), [&](const RowGroup& c) {
        return c.kind == RowKind::kContact && data.deformation[c.row] < 0.0;
      });
  if (compressed > memory_layout.contacts)
    throw std::runtime_error(std::to_string(compressed) + " contacts exceed the memory for " +
                             std::to_string(memory_layout.contacts) +
                             " contacts that data reserve: make the engine of a model whose geoms "
                             "may touch as they do now");
}

Memory Stepper::Impl::memory(mjData_* d) const {
  return Memory(host::memory(model, d, memory_layout.size()), memory_layout);
}

StepView Stepper::Impl::view(mjData_* d) const {
  return {clock.length, contacts, constraints, memory(d), matches};
}

Stepper::Stepper(mjModel_* model, const Parameters& parameters, int threads)
    : impl_(std::make_unique<Impl>(model, parameters, threads)) {}
Stepper::~Stepper() = default;
Stepper::Stepper(Stepper&&) noexcept = default;
Stepper& Stepper::operator=(Stepper&&) noexcept = default;

StepStats Stepper::step(mjData_* data, int nstep, bool leave_rows,
                        const std::function<void()>& between) {
  StepStats total;
  for (int i = 1; i <= nstep; ++i) {
    accumulate(impl_->step(data, leave_rows && i == nstep), total);
    if (between && i < nstep) between();
  }
  return total;
}

}  // namespace dashpot
