#include "dashpot/step/engine.hpp"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <string>

#include "comfree_stepper.hpp"
#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/model/constraint_memory.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/features.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/sleep.hpp"
#include "dashpot/model/state.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

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

// Puts back, where a step throws, the memory that it had before something was forgotten.
struct MemoryAtStart {
  double* storage;
  std::vector<double> before;  // empty: nothing was
  ~MemoryAtStart() { std::copy(before.begin(), before.end(), storage); }
};

}  // namespace

Stepper::Impl::Impl(mjModel_* m, const Parameters& p, int threads, bool own)
    : team(threads), model(m), parameters(p), motion(m, own), trapezoid(m) {
  host::check_supported(m, p.options);
  const int geoms = host::geom_count(m);
  if (static_cast<int>(p.geom_material.size()) != geoms)
    throw std::invalid_argument("geom_material has " + std::to_string(p.geom_material.size()) +
                                " entries; the model has " + std::to_string(geoms) + " geoms");
  detection.takes_faces = detection.looks_ahead = rows.weighs_all = own;
  memory_layout = dashpot::memory_layout(m, p.contact_capacity);
  data_size = host::data_size(m);
}

// Takes a step, on several threads unless they are slower.
StepStats Stepper::Impl::step(mjData_* d, bool leave_rows) {
  if (team.size() == 1) return take_step(d, leave_rows);
  const auto start = std::chrono::steady_clock::now();
  team.begin(pace.shares());
  const StepStats taken = take_step(d, leave_rows);
  pace.note(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return taken;
}

StepStats Stepper::Impl::take_step(mjData_* d, bool leave_rows) {
  follow_edits();
  host::check_data(model, d, data_size);
  memory(d).check();
  const host::ErrorGuard guard(d);
  host::MocapMotion mocap(model, d, motion.own(), parameters.options.mocap_timeconst, memory(d),
                          mocap_buffers);
  MemoryAtStart at_start{host::memory(model, d, memory_layout.size()), {}};
  forget_moved_by_hand(d, at_start.before);
  const host::DampersInRows dampers(model, motion.own() && in_touch(d), detection.dampers);
  host::Substeps substeps(model, d);
  host::SleepAtStart sleep(model, d, sleeping.at_start());
  detection.contact_rows = host::anything_reads_rows(model) ? host::ContactRows::kRequired
                           : leave_rows                     ? host::ContactRows::kIfTheyFit
                                                            : host::ContactRows::kNone;
  clock = StepClock();
  clock.whole = substeps.whole();
  StepStats total;
  int taken = 0;
  for (double remaining = clock.whole; remaining > kSliverOfStep * clock.whole;
       remaining -= clock.length) {
    clock.length = remaining;
    if (substeps.cut()) substeps.set_length(clock.length);
    advance(d, substeps, mocap);
    clock.cuts += clock.cut_short;
    substeps.end_substep();
    accumulate(stats, total);
    ++taken;
  }
  substeps.finish();
  sleep.finish();
  at_start.before.clear();
  fall_asleep(d, mocap);
  total.cuts = clock.cuts;
  total.parts = taken;
  return total;
}

// Checks what was edited of the model since the last step, and follows it.
void Stepper::Impl::follow_edits() {
  if (kept_model.is_same(model)) return;
  host::check_options(model, parameters.options.law);
  host::follow_edited_masses(model);
  may_have_rows = host::may_have_rows(model);
  detection.candidates.forget();
  kept_model.keep(model);
}

// Whether rows acted in the last step, or, before the first one, equalities may.
bool Stepper::Impl::in_touch(mjData_* d) const {
  const Memory of_last = memory(d);
  return of_last.starts() ? host::has_equalities(model) : of_last.has_rows();
}

void Stepper::Impl::advance(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap) {
  const bool new_control = !substeps.cut();
  start_substep(d, new_control, host::Sensors::kForCallbacks, is_rough(substeps), mocap);
  solve_substep(d, substeps, mocap);
  find_forces(d);
  report_forces(d);
  advance_state(d);
  mocap.write_velocities();
  accounting.add_smooth_work(d, solved_substep(), team);
  accounting.ledger().work += mocap.work_against_gravity(clock.length);
  mocap.advance(clock.length);
  remember(d, mocap);
}

void Stepper::Impl::start_substep(mjData_* d, bool new_control, host::Sensors sensors, bool rough,
                                  host::MocapMotion& mocap) {
  motion.start(d, may_have_rows);
  mocap.begin(clock.length);
  host::wake_switched(model, d, memory(d));
  host::smooth_stage(model, d, new_control, sensors, find_contacts);
  mocap.write_velocities();
  motion.find_smooth_motion(d, clock.length, rough, data, team);
}

void Stepper::Impl::detect(mjData_* d, host::MocapMotion& mocap) {
  do {
    host::detect(model, d, motion.smooth_acceleration(), memory(d).held_motion().displacement,
                 detection, contacts, constraints, team);
    mocap.drive(constraints);
  } while (wake_reached(d, mocap));
  sleeping.leave_out(model, d, contacts, constraints);
  substep = Substep();
  correct_contacts_ahead(d);
  mocap.drive(contacts);
}

// Corrects contacts of bodies in flight, which may meet elsewhere than found, or pass by.
void Stepper::Impl::correct_contacts_ahead(mjData_* d) {
  flights.follow(model, d, detection.buffers, constraints, clock.length, contacts);
}

// Wakes what found contacts and constraints reach, and finds how that moves; returns whether any.
bool Stepper::Impl::wake_reached(mjData_* d, const host::MocapMotion& mocap) {
  if (!sleeping.wake_reached(model, d, contacts, constraints, mocap)) return false;
  host::smooth_stage(model, d, false, host::Sensors::kStay, find_contacts);
  mocap.write_velocities();
  motion.find_smooth_motion(d, clock.length, false, data, team);
  return true;
}

// Puts islands to sleep that have come to rest. What memory keeps of their motion is forgotten.
void Stepper::Impl::fall_asleep(mjData_* d, const host::MocapMotion& mocap) {
  if (!host::may_sleep(model)) return;
  const SolvedSubstep solved = solved_substep();
  const std::vector<int>& falling =
      sleeping.find_falling(d, solved, islands.all(), mocap, accounting.recovered());
  if (falling.empty()) return;
  Memory view = memory(d);
  accounting.lose_motion(d, solved, falling, view);
  sleeping.put_to_sleep(model, d);
  for (int index : falling) view.rest(motion.trees().tree[index], index);
}

// Memory is of a configuration: what was moved since the last step begins anew. Small displacements
// that steps are differentiated by leave it.
void Stepper::Impl::forget_moved_by_hand(mjData_* d, std::vector<double>& before) {
  Memory view = memory(d);
  thread_local std::vector<char> dof;
  if (differentiable || view.starts()) return;
  const bool any = host::find_moved_by_hand(model, d, view.position(), dof);
  if (!any && mocap_buffers.jumped.empty()) return;
  const double* storage = host::memory(model, d, memory_layout.size());
  before.assign(storage, storage + memory_layout.size());
  MarkedRows moved;
  host::mark_rows(model, dof, mocap_buffers.jumped, moved);
  view.forget(moved);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& tree = motion.trees().tree[index];
    const auto first = dof.begin() + tree.dof_begin;
    if (std::find(first, first + tree.dof_count, 1) != first + tree.dof_count)
      view.rest(tree, index);
  }
}

// Goes as far into a step as the Verlet corrector of the last one is known.
void Stepper::Impl::complete_last_step(mjData_* d) {
  const HeldMotion before = memory(d).held_motion();
  if (std::none_of(before.length, before.length + memory_layout.held_trees,
                   [](double length) { return length > 0.0; }))
    return;
  const host::ErrorGuard guard(d);
  follow_edits();
  const host::DampersInRows dampers(model, in_touch(d), detection.dampers);
  host::MocapMotion mocap(model, d, true, parameters.options.mocap_timeconst, memory(d),
                          mocap_buffers);
  detection.contact_rows = host::ContactRows::kNone;
  clock = StepClock();
  clock.whole = clock.length = host::Substeps(model, d).whole();
  start_substep(d, true, host::Sensors::kStay, false, mocap);
  detect(d, mocap);
  find_rows(d, mocap);
  if (const double* added = trapezoid.added_velocity())
    for (int index = 0; index < motion.tree_count(); ++index)
      if (trapezoid.holds(index)) motion.add_velocity(d, index, added);
}

void Stepper::Impl::remember(mjData_* d, const host::MocapMotion& mocap) {
  Memory view = memory(d);
  mocap.remember(view);
  view.remember(contacts, constraints, rows, data, compressed, sleeping.rows(), team);
  std::copy_n(host::position(d), memory_layout.positions, view.position());
  if (double* end_velocity = view.end_velocity())
    std::copy_n(host::velocity(d), motion.start_velocity().size(), end_velocity);
  const bool leaves_corrector = motion.own() && !geometry_of_middle;
  trapezoid.keep(d,
                 {clock.length, leaves_corrector, constraints, rows, data, on_trees.held,
                  accounting.displacement()},
                 motion, view, accounting.ledger());
  accounting.close(view);
}

Memory Stepper::Impl::memory(mjData_* d) const {
  return Memory(host::memory(model, d, memory_layout.size()), memory_layout);
}

Stepper::Stepper(mjModel_* model, const Parameters& parameters, int threads)
    : impl_(parameters.options.law == Law::kComFree
                ? std::make_unique<ComFreeImpl>(model, parameters, threads)
                : std::make_unique<Impl>(model, parameters, threads)) {}
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

void Stepper::differentiate(bool whether) { impl_->differentiable = whether; }

void Stepper::complete_last_step(mjData_* data) { impl_->complete_last_step(data); }

}  // namespace dashpot
