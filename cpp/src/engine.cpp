#include "dashpot/engine.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/comfree.hpp"
#include "dashpot/contacts.hpp"
#include "dashpot/energy_ledger.hpp"
#include "dashpot/flight_contacts.hpp"
#include "dashpot/impact.hpp"
#include "dashpot/islands.hpp"
#include "dashpot/knock_on.hpp"
#include "dashpot/leapfrog.hpp"
#include "dashpot/memory.hpp"
#include "dashpot/microstep.hpp"
#include "dashpot/middle.hpp"
#include "dashpot/mocap_motion.hpp"
#include "dashpot/mujoco_errors.hpp"
#include "dashpot/mujoco_host.hpp"
#include "dashpot/mujoco_turning.hpp"
#include "dashpot/position_recovery.hpp"
#include "dashpot/pressed_together.hpp"
#include "dashpot/row_assembly.hpp"
#include "dashpot/rows.hpp"
#include "dashpot/solref.hpp"
#include "dashpot/trapezoid.hpp"
#include "dashpot/tree_motion.hpp"

namespace dashpot {

namespace {

// Times that a step is taken anew for what its impacts bring about: bodies that a blow runs through
// within one step, at most.
constexpr int kMostTurns = 16;

void accumulate(const StepStats& step, StepStats& total) {
  total.contacts = step.contacts;
  total.touching = step.touching;
  total.islands = step.islands;
  total.microsteps = std::max(total.microsteps, step.microsteps);
  total.clipped = std::max(total.clipped, step.clipped);
  total.max_penetration = std::max(total.max_penetration, step.max_penetration);
  total.max_compression = std::max(total.max_compression, step.max_compression);
  total.cuts += step.cuts;
}

}  // namespace

struct Stepper::Impl {
  Impl(mjModel_* m, const Parameters& p);
  StepStats step(mjData_* d, bool leave_rows);
  void advance(mjData_* d, host::StepParts& parts, host::MocapMotion& mocap);
  void solve(mjData_* d, host::MocapMotion& mocap);

  // The stages of a step (DESIGN section 2).
  void correct_contacts_ahead(mjData_* d);
  void cut_at_impact(mjData_* d, host::StepParts& parts);
  void follow_knock_on(mjData_* d, host::MocapMotion& mocap);
  void take_turning_contacts_to_middle(mjData_* d);
  void build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart,
                                host::MocapMotion& mocap);
  void build_rows(mjData_* d);
  void finish_last_step(mjData_* d);
  void plan_and_recall(mjData_* d);
  void run_islands();
  void update_complementarity_free(mjData_* d);
  void report_forces(mjData_* d);
  void advance_state(mjData_* d, bool new_control);
  void account_smooth_work(mjData_* d);
  void remember(mjData_* d, const host::MocapMotion& mocap);

  void find_touched_trees();
  bool rows_moved_something() const;
  void find_mean_velocity();
  void find_end_gaps();
  bool lands_in_next_step(const RowGroup& c) const;
  bool gets_second_half_in_flight(int tree) const;
  void check_velocities() const;
  Memory memory(mjData_* d) const;
  StepStats statistics() const;

  mjModel_* model;
  Parameters parameters;
  MemoryLayout memory_layout;
  long long data_size;
  TreeMotion motion;
  Leapfrog leapfrog;
  Trapezoid trapezoid;

  // Rebuilt in every step.
  double length = 0.0;  // H, s, of the step or the part of it
  int cuts = 0;
  Part part;
  FlightContacts flights;
  KnockOn knock_on;
  ProvenApart proven_apart;
  host::Detection detection;
  host::MocapBuffers mocap_buffers;
  bool geometry_of_middle = false;  // of the part, not of its start
  std::vector<ContactInput> contacts;
  std::vector<ConstraintInput> constraints;
  std::vector<GroupMaterial> materials;  // per group
  std::vector<double> sag_time;          // per group, see Islands::plan
  Rows rows;
  RowData data;
  PressedTogether pressed_together;
  Islands islands;
  MicrostepLoop microsteps;
  std::vector<double> constraint_force, row_force;
  std::vector<double> gaps, effective_masses;  // per group, of the complementarity-free law
  std::vector<char> touched;                   // by tree: rows moved it
  std::vector<char> held;                      // by tree: rows that have a position moved it
  std::vector<char> turned;                    // by tree: its inertia is that of the middle
  std::vector<double> mean_displacement;       // generalized
  std::vector<double> mean_velocity;           // generalized
  std::vector<double> end_gap;                 // by contact, m
  std::vector<double> recovery_displacement;   // of equalities, in motion coordinates
  std::vector<double> recovered;               // the same, generalized
  host::RungeKutta runge_kutta;
  host::SmoothWork smooth_work;
  EnergyLedger ledger;
};

Stepper::Impl::Impl(mjModel_* m, const Parameters& p)
    : model(m),
      parameters(p),
      motion(m, p.options.law != Law::kComFree),
      runge_kutta(p.options.law == Law::kComFree) {
  host::check_supported(m, p.options.law);
  if (p.options.impact == Impact::kCut && p.options.law != Law::kKelvinVoigt)
    throw std::invalid_argument("only law kelvin_voigt cuts steps at impacts");
  if (p.options.impact == Impact::kCut && host::has_flexes(m))
    throw std::invalid_argument("impact \"cut\" does not see flexes; use \"none\"");
  const int geoms = host::geom_count(m);
  if (static_cast<int>(p.geom_material.size()) != geoms)
    throw std::invalid_argument("geom_material has " + std::to_string(p.geom_material.size()) +
                                " entries; the model has " + std::to_string(geoms) + " geoms");
  detection.takes_faces = p.options.law != Law::kComFree;
  memory_layout = dashpot::memory_layout(m);
  data_size = host::data_size(m);
}

StepStats Stepper::Impl::step(mjData_* d, bool leave_rows) {
  host::check_options(model, parameters.options.law);
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
  cuts = 0;
  proven_apart.clear();
  StepStats total;
  for (double remaining = parts.whole(); remaining > 0.0; remaining -= length) {
    length = remaining;
    if (parts.cut()) parts.set_length(length);
    advance(d, parts, mocap);
    accumulate(statistics(), total);
  }
  parts.finish();
  total.cuts = cuts;
  return total;
}

void Stepper::Impl::advance(mjData_* d, host::StepParts& parts, host::MocapMotion& mocap) {
  motion.start(d);
  mocap.begin(length);
  const bool new_control = !parts.cut();
  host::smooth_stage(model, d, new_control);
  mocap.write_velocities();
  // A part that another will follow needs no more than directions for the search of its end.
  const bool rough = parts.cut() && cuts < kMaxCuts;
  const double searched = length;
  motion.find_smooth_motion(d, length, rough, data);
  host::detect(model, d, motion.smooth_acceleration(), detection, contacts, constraints);
  mocap.drive(constraints);
  part = Part();
  correct_contacts_ahead(d);
  if (parameters.options.impact == Impact::kCut) cut_at_impact(d, parts);
  if (rough || length != searched) motion.find_smooth_motion(d, length, false, data);
  solve(d, mocap);
  follow_knock_on(d, mocap);
  report_forces(d);
  advance_state(d, new_control);
  mocap.write_velocities();
  account_smooth_work(d);
  ledger.work += mocap.work_against_gravity(length);
  mocap.advance(length);
  remember(d, mocap);
  proven_apart.forget(touched);
}

// Rows, and what they do over the step.
void Stepper::Impl::solve(mjData_* d, host::MocapMotion& mocap) {
  geometry_of_middle = !part.impact.empty();
  turned.assign(motion.tree_count(), 0);
  if (geometry_of_middle) {
    build_rows_in_the_middle(d, part.apart, mocap);
    give_rigid_impacts_springs(memory(d), part.impact, contacts, rows, length, materials);
  } else {
    take_turning_contacts_to_middle(d);
    build_rows(d);
  }
  if (parameters.options.law == Law::kComFree) {
    update_complementarity_free(d);
  } else {
    finish_last_step(d);
    plan_and_recall(d);
    run_islands();
  }
}

// Takes the part of the step anew while its impacts bring about more contacts.
void Stepper::Impl::follow_knock_on(mjData_* d, host::MocapMotion& mocap) {
  if (parameters.options.law == Law::kComFree) return;
  for (int turn = 0; turn < kMostTurns && rows_moved_something(); ++turn) {
    find_mean_velocity();
    find_end_gaps();
    if (!knock_on.comes_to_more(model, d, mean_velocity, length, contacts, end_gap,
                                detection.buffers))
      return;
    const size_t known = contacts.size() + constraints.size();
    motion.find_smooth_motion(d, length, false, data);
    host::detect_again(model, d, motion.smooth_acceleration(), detection, contacts, constraints);
    mocap.drive(constraints);
    correct_contacts_ahead(d);
    drop_pairs(part.apart, contacts);
    solve(d, mocap);
    if (contacts.size() + constraints.size() == known) return;
  }
}

bool Stepper::Impl::rows_moved_something() const {
  return std::find(touched.begin(), touched.end(), 1) != touched.end();
}

// Of trees that no row moved, that of the smooth motion.
void Stepper::Impl::find_mean_velocity() {
  const std::vector<double>& start = motion.start_velocity();
  mean_velocity = start;
  for (size_t i = 0; i < start.size(); ++i)
    mean_velocity[i] += 0.5 * length * motion.smooth_acceleration()[i];
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!touched[index]) continue;
    const Tree& tree = motion.trees().tree[index];
    double* mean = mean_velocity.data() + tree.dof_begin;
    motion.to_generalized(index, data.total_displacement.data() + tree.begin, mean);
    for (int i = 0; i < tree.dof_count; ++i) mean[i] /= length;
  }
}

// Positions, not compressions.
void Stepper::Impl::find_end_gaps() {
  end_gap.resize(contacts.size());
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kContact) end_gap[c.input] = data.deformation[c.row] - data.offset[i];
  }
}

// Bodies in flight may meet elsewhere than found, or pass by. With the complementarity-free law
// contact does not start within a step.
void Stepper::Impl::correct_contacts_ahead(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  flights.follow(model, d, detection.buffers, constraints, length, contacts);
}

// Ends this part of the step where the next impact begins.
void Stepper::Impl::cut_at_impact(mjData_* d, host::StepParts& parts) {
  part = part_before_impact(model, d, memory(d), motion.smooth_acceleration(), constraints,
                            contacts, parts.whole(), length, kMaxCuts - cuts, proven_apart);
  drop_pairs(part.apart, contacts);
  if (part.length == length) return;
  ++cuts;
  length = part.length;
  parts.set_length(length);
}

// The inertia of a free body goes there too, unless constraints hold it, which are those of the
// start.
void Stepper::Impl::take_turning_contacts_to_middle(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  host::take_to_middle(model, d, length, motion.trees(), data.velocity.data(), detection.faces,
                       contacts, turned);
  for (const ConstraintInput& constraint : constraints)
    for (int tree : constraint.tree)
      if (tree >= 0) turned[tree] = 0;
  for (int tree = 0; tree < motion.tree_count(); ++tree) {
    turned[tree] = turned[tree] && motion.can_freeze_ahead(tree);
    if (turned[tree]) motion.freeze_ahead(tree, 0.5 * length);
  }
}

void Stepper::Impl::build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart,
                                             host::MocapMotion& mocap) {
  const std::vector<ContactInput> start = contacts;
  const std::vector<ConstraintInput> start_constraints = constraints;
  mocap.show(0.5 * length);
  const host::MiddleGeometry middle(model, d, motion.smooth_acceleration(), detection, contacts,
                                    constraints);
  drop_pairs(apart, contacts);
  drop_pairs(flights.near_misses(), contacts);
  mocap.drive(constraints);
  motion.freeze_at_middle(d, length, data);
  build_rows(d);
  give_back_way(rows, data, length, start, start_constraints, contacts, constraints);
  mocap.show(0.0);
}

void Stepper::Impl::build_rows(mjData_* d) {
  if (static_cast<int>(contacts.size()) > memory_layout.contacts)
    throw std::runtime_error(std::to_string(contacts.size()) + " contacts exceed the memory for " +
                             std::to_string(memory_layout.contacts) +
                             " contacts that data reserve");
  assemble_rows(model, d, parameters, constraints, contacts, motion, rows, materials);
}

void Stepper::Impl::finish_last_step(mjData_* d) {
  const Memory view = memory(d);
  ledger = view.ledger();
  trapezoid.finish_last_step(model, d, length, view, constraints, motion, rows, data, ledger);
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  islands.find(rows, motion.trees());
  find_sag_times(model, rows, contacts, sag_time);
  pressed_together.find(materials, contacts, motion.trees(), data, length, rows);
  islands.plan(rows, motion.trees(), materials, sag_time, length, parameters.options);
  Memory view = memory(d);
  view.recall(contacts, constraints, rows, parameters.options.recovery_speed, length, data);
  if (!part.impact.empty() && !std::isinf(parameters.options.recovery_speed))
    view.limit_compression(part.impact, contacts, rows, data);
  leapfrog.fall_back(model, view, motion, rows, data);
}

void Stepper::Impl::run_islands() {
  const EnergyShares before = elastic_energy(rows, data);
  for (const Island& island : islands.all())
    if (!stays_apart(rows, island, length, data))
      microsteps.run(rows, motion.trees(), island, parameters.options.recovery_speed, data);
  check_velocities();
  find_touched_trees();
  leapfrog.lead(length, held, motion, rows, data);
  book_rows(data, before, elastic_energy(rows, data), ledger);
  recovery_displacement.assign(motion.trees().coordinates, 0.0);
  for (const Island& island : islands.all()) {
    const double strained =
        recover_positions(rows, motion.trees(), island, parameters.options.recovery_speed, length,
                          data, recovery_displacement);
    ledger.dissipated_recovery -= strained;
    ledger.elastic += strained;
  }
  for (int i = 0; i < motion.trees().coordinates; ++i)
    data.total_displacement[i] += recovery_displacement[i];
}

// Nothing is remembered but the ledger, and no spring stores energy.
void Stepper::Impl::update_complementarity_free(mjData_* d) {
  data.reset_rows(rows);
  islands.find(rows, motion.trees());
  ledger = memory(d).ledger();
  gaps.clear();
  effective_masses.clear();
  for (const RowGroup& c : rows.group) {
    // Equalities and dry friction loss can enter by edits of the model.
    if (c.kind == RowKind::kBilateral || c.kind == RowKind::kSlider)
      host::check_supported(model, parameters.options.law);
    const bool contact = c.kind == RowKind::kContact;
    gaps.push_back(contact ? contacts[c.input].gap : constraints[c.input].position);
    effective_masses.push_back(effective_mass(
        impedance(contact ? contacts[c.input].solimp : constraints[c.input].solimp, gaps.back()),
        rows.typical_inverse_mass[c.row]));
  }
  const ComFree law{parameters.options.comfree_stiffness, parameters.options.comfree_damping};
  dashpot::update_complementarity_free(law, rows, motion.trees(), gaps, effective_masses, length,
                                       data);
  check_velocities();
  find_touched_trees();
  book_rows(data, {}, {}, ledger);
}

void Stepper::Impl::find_touched_trees() {
  touched.assign(motion.tree_count(), 0);
  held.assign(motion.tree_count(), 0);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!data.touched[i] && !lands_in_next_step(c)) continue;
    for (int tree : c.tree) {
      if (tree < 0) continue;
      touched[tree] = 1;
      held[tree] |= c.kind != RowKind::kSlider;
    }
  }
}

// Where the semi-implicit update would take a tree into an overlap that its motion does not have,
// it takes the motion of the micro-steps: otherwise a tree at rest is thrown back by the recovery
// of that overlap, step after step.
bool Stepper::Impl::lands_in_next_step(const RowGroup& c) const {
  if (parameters.options.law == Law::kComFree) return false;
  const double gap =
      c.kind == RowKind::kContact ? contacts[c.input].gap : constraints[c.input].position;
  return overlaps_semi_implicitly(rows, c, gap, motion.start_motion().data(),
                                  data.smooth_acceleration.data(), length);
}

void Stepper::Impl::check_velocities() const {
  for (const Tree& tree : motion.trees().tree)
    check_bounded(tree, data.velocity.data(), host::kLargestValue);
}

void Stepper::Impl::report_forces(mjData_* d) {
  constraint_force.assign(motion.start_velocity().size(), 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& tree = motion.trees().tree[index];
    if (touched[index])
      motion.to_generalized_force(index, data.coordinate_impulse.data() + tree.begin,
                                  constraint_force.data() + tree.dof_begin);
  }
  for (double& force : constraint_force) force /= length;
  row_force = data.total_impulse;
  for (double& force : row_force) force /= length;
  host::report_forces(model, d, constraint_force, contacts, constraints, rows, row_force);
}

// MuJoCo's integrator starts from it then.
bool Stepper::Impl::gets_second_half_in_flight(int tree) const {
  return !touched[tree] && trapezoid.holds(tree) && trapezoid.added_velocity();
}

// The complementarity-free law asks for contacts at the end of a step that goes all the way with
// its velocity there, as other integrators of MuJoCo do.
void Stepper::Impl::advance_state(mjData_* d, bool new_control) {
  for (int index = 0; index < motion.tree_count(); ++index)
    if (gets_second_half_in_flight(index))
      host::add_velocity(d, motion.trees().tree[index], trapezoid.added_velocity());
  host::integrate(model, d, new_control, runge_kutta);
  const bool comfree = parameters.options.law == Law::kComFree;
  if (comfree && !host::is_runge_kutta(model)) return;
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (comfree) {
      if (touched[index]) motion.advance_semi_implicitly(d, index, length);
      continue;
    }
    motion.advance(d, index, length,
                   {touched[index] != 0, held[index] != 0, geometry_of_middle || turned[index],
                    trapezoid.holds(index), trapezoid.added_velocity()},
                   data);
    if (const double* ahead = leapfrog.goes_ahead(index)) {
      const Tree& tree = motion.trees().tree[index];
      host::move_tree(model, d, tree, ahead + tree.begin);
    }
  }
}

// Trees that rows moved went the integral of their velocity and what recovery displaced them; the
// change of kinetic energy of all others goes with their mean velocity, also that of trees which
// dry friction alone slows where RK4 integrates them.
void Stepper::Impl::account_smooth_work(mjData_* d) {
  const auto moved = [&](int tree) {
    return touched[tree] &&
           (held[tree] || !host::is_runge_kutta(model) || !motion.integrated()[tree]);
  };
  const double* velocity = host::velocity(d);
  const std::vector<double>& start_velocity = motion.start_velocity();
  mean_displacement.resize(start_velocity.size());
  for (size_t i = 0; i < start_velocity.size(); ++i)
    mean_displacement[i] = 0.5 * length * (start_velocity[i] + velocity[i]);
  if (parameters.options.law != Law::kComFree) {
    recovered.assign(start_velocity.size(), 0.0);
    for (int index = 0; index < motion.tree_count(); ++index) {
      const Tree& tree = motion.trees().tree[index];
      if (gets_second_half_in_flight(index)) {
        const double* added = trapezoid.added_velocity() + tree.begin;
        for (int i = 0; i < tree.dof_count; ++i)
          mean_displacement[tree.dof_begin + i] += 0.5 * length * added[i];
      }
      if (!moved(index)) continue;
      double* mean = mean_displacement.data() + tree.dof_begin;
      double* shift = recovered.data() + tree.dof_begin;
      motion.to_generalized(index, data.total_displacement.data() + tree.begin, mean);
      motion.to_generalized(index, recovery_displacement.data() + tree.begin, shift);
      for (int i = 0; i < tree.dof_count; ++i) mean[i] -= shift[i];
      if (!tree.free_body)
        for (int i = 0; i < tree.dof_count; ++i) mean[i] -= data.shift[tree.begin + i];
    }
    ledger.dissipated_recovery += host::potential_work(model, d, recovered.data());
  }
  smooth_work.find(
      model, d, motion.trees(),
      {start_velocity.data(), mean_displacement.data(), motion.smooth_acceleration().data(),
       &touched, host::is_runge_kutta(model) ? &runge_kutta.end() : nullptr, &motion.integrated()});
  ledger.dissipated_damping -= smooth_work.damping;
  ledger.work += smooth_work.applied;
  book_left_to_rows(rows, data, smooth_work.group, smooth_work.left_to_rows, ledger);
  for (const RowGroup& c : rows.group)
    ledger.work += surface_work(rows, c, data.total_impulse.data() + c.row);
}

void Stepper::Impl::remember(mjData_* d, const host::MocapMotion& mocap) {
  Memory view = memory(d);
  mocap.remember(view);
  view.remember(contacts, constraints, rows, data);
  if (double* end_velocity = view.end_velocity())
    std::copy_n(host::velocity(d), motion.start_velocity().size(), end_velocity);
  leapfrog.keep(length, held, motion, view);
  const bool leaves_half = parameters.options.law != Law::kComFree && !geometry_of_middle;
  trapezoid.keep(model, d, length, leaves_half, held, leapfrog.fell_back(), mean_displacement,
                 constraints, motion, rows, data, view, ledger);
  view.set_ledger(ledger);
}

Memory Stepper::Impl::memory(mjData_* d) const {
  return Memory(host::memory(model, d, memory_layout.size()), memory_layout);
}

StepStats Stepper::Impl::statistics() const {
  StepStats stats;
  stats.contacts = static_cast<int>(contacts.size());
  stats.islands = static_cast<int>(islands.all().size());
  for (const Island& island : islands.all()) {
    stats.microsteps = std::max(stats.microsteps, island.microsteps);
    stats.clipped += island.clipped;
  }
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact) continue;
    stats.touching += data.touched[i];
    stats.max_penetration = std::max(stats.max_penetration, -contacts[c.input].gap);
    stats.max_compression = std::max(stats.max_compression, -data.deformation[c.row]);
  }
  return stats;
}

Stepper::Stepper(mjModel_* model, const Parameters& parameters)
    : impl_(std::make_unique<Impl>(model, parameters)) {}
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
