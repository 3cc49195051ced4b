#include "dashpot/engine.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

#include "dashpot/comfree.hpp"
#include "dashpot/contacts.hpp"
#include "dashpot/free_body.hpp"
#include "dashpot/impact.hpp"
#include "dashpot/islands.hpp"
#include "dashpot/memory.hpp"
#include "dashpot/microstep.hpp"
#include "dashpot/middle.hpp"
#include "dashpot/mujoco_host.hpp"
#include "dashpot/position_recovery.hpp"
#include "dashpot/rows.hpp"

namespace dashpot {

namespace {

// The coordinates of a free body without their zeros.
Vector6 of_body(const double* coordinates) {
  Vector6 body;
  std::copy_n(coordinates, 3, body.data());
  std::copy_n(coordinates + 4, 3, body.data() + 3);
  return body;
}

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
  void advance(mjData_* d, host::StepParts& parts);

  // The stages of a step (DESIGN section 2).
  void read_state(const mjData_* d);
  void find_smooth_acceleration(mjData_* d, bool rough = false);
  void cut_at_impact(mjData_* d, host::StepParts& parts);
  void build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart);
  void give_rigid_impacts_springs(mjData_* d, const std::vector<GeomPair>& impact);
  void freeze_at_middle(const mjData_* d);
  void build_rows(mjData_* d);
  void plan_and_recall(mjData_* d);
  void find_sag_times();
  void run_islands();
  void update_complementarity_free(mjData_* d);
  void report_forces(mjData_* d);
  void advance_state(mjData_* d);
  void account_smooth_work(mjData_* d);
  void remember(mjData_* d);

  void append_constraint(int index, mjData_* d);
  void append_contact(int index, mjData_* d);
  bool moves_as_free_body(int tree) const;
  void invert_inertia_of(const std::array<int, 2>& tree);
  void to_coordinates(int tree, const double* generalized, double* coordinates) const;
  void to_generalized(int tree, const double* coordinates, double* generalized) const;
  void find_touched_trees();
  bool lands_in_next_step(const RowGroup& c) const;
  void check_finite() const;
  void update_ledger(const EnergyShares& before, const EnergyShares& after);
  double contact_work(int tree) const;
  void advance_tree(mjData_* d, int tree);
  Memory memory(mjData_* d) const;
  StepStats statistics() const;

  mjModel_* model;
  Parameters parameters;
  MemoryLayout memory_layout;
  long long data_size;

  // Rebuilt in every step.
  double length = 0.0;  // H, s, of the step or the part of it
  int cuts = 0;
  Part part;
  ProvenApart proven_apart;
  host::Detection detection;
  bool geometry_of_middle = false;  // of the part, not of its start
  std::vector<double> start_position, start_velocity;
  Trees trees;
  std::vector<ContactInput> contacts;
  std::vector<ConstraintInput> constraints;
  std::vector<GroupMaterial> materials;  // per group
  std::vector<double> sag_time;          // per group, see Islands::plan
  Rows rows;
  RowData data;
  Islands islands;
  MicrostepLoop microsteps;
  std::vector<FreeMotion> free_motion;      // by tree; meaningful for free bodies
  std::vector<double> inertia_factor;       // of trees that are not free bodies
  AlignedDoubles start_motion;              // start velocity in motion coordinates
  std::vector<char> inverted;               // by tree: its inverse inertia is filled in
  std::vector<double> smooth_acceleration;  // generalized
  std::vector<double> constraint_force, row_force;
  std::vector<double> displacement;           // generalized, of one tree
  std::vector<char> touched;                  // by tree: rows moved it
  std::vector<char> held;                     // by tree: rows that have a position moved it
  std::vector<double> mean_displacement;      // generalized
  std::vector<double> recovery_displacement;  // of equalities, in motion coordinates
  std::vector<double> recovered;              // the same, generalized
  EnergyLedger ledger;
};

Stepper::Impl::Impl(mjModel_* m, const Parameters& p) : model(m), parameters(p) {
  host::check_supported(m, p.options.law);
  if (p.options.impact == Impact::kCut && p.options.law != Law::kKelvinVoigt)
    throw std::invalid_argument("only law kelvin_voigt cuts steps at impacts");
  if (p.options.impact == Impact::kCut && host::has_flexes(m))
    throw std::invalid_argument("impact \"cut\" does not see flexes; use \"none\"");
  const int geoms = host::geom_count(m);
  if (static_cast<int>(p.geom_material.size()) != geoms)
    throw std::invalid_argument("geom_material has " + std::to_string(p.geom_material.size()) +
                                " entries; the model has " + std::to_string(geoms) + " geoms");
  memory_layout = dashpot::memory_layout(m);
  data_size = host::data_size(m);
  trees = host::make_trees(m);
}

StepStats Stepper::Impl::step(mjData_* d, bool leave_rows) {
  host::check_options(model, parameters.options.law);
  host::check_data(model, d, data_size);
  host::StepParts parts(model, d);
  detection.contact_rows = leave_rows || host::anything_reads_rows(model);
  cuts = 0;
  proven_apart.clear();
  StepStats total;
  for (double remaining = parts.whole(); remaining > 0.0; remaining -= length) {
    length = remaining;
    if (parts.cut()) parts.set_length(length);
    advance(d, parts);
    accumulate(statistics(), total);
  }
  parts.finish();
  total.cuts = cuts;
  return total;
}

void Stepper::Impl::advance(mjData_* d, host::StepParts& parts) {
  read_state(d);
  host::smooth_stage(model, d, !parts.cut());
  // A part that another will follow needs no more than directions for the search of its end.
  const bool rough = parts.cut() && cuts < kMaxCuts;
  const double searched = length;
  find_smooth_acceleration(d, rough);
  host::detect(model, d, smooth_acceleration, detection, contacts, constraints);
  part = Part();
  if (parameters.options.impact == Impact::kCut) cut_at_impact(d, parts);
  if (rough || length != searched) find_smooth_acceleration(d);
  geometry_of_middle = !part.impact.empty();
  if (geometry_of_middle) {
    build_rows_in_the_middle(d, part.apart);
    give_rigid_impacts_springs(d, part.impact);
  } else {
    build_rows(d);
  }
  if (parameters.options.law == Law::kComFree) {
    update_complementarity_free(d);
  } else {
    plan_and_recall(d);
    run_islands();
  }
  report_forces(d);
  advance_state(d);
  account_smooth_work(d);
  remember(d);
  proven_apart.forget(touched);
}

// Ends this part of the step where the next impact begins.
void Stepper::Impl::cut_at_impact(mjData_* d, host::StepParts& parts) {
  part = part_before_impact(model, d, memory(d), smooth_acceleration, constraints, contacts,
                            parts.whole(), length, kMaxCuts - cuts, proven_apart);
  drop_pairs(part.apart, contacts);
  if (part.length == length) return;
  ++cuts;
  length = part.length;
  parts.set_length(length);
}

void Stepper::Impl::build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart) {
  const std::vector<ContactInput> start = contacts;
  const std::vector<ConstraintInput> start_constraints = constraints;
  const host::MiddleGeometry middle(model, d, smooth_acceleration, detection, contacts,
                                    constraints);
  drop_pairs(apart, contacts);
  freeze_at_middle(d);
  build_rows(d);
  std::vector<double> way;  // m, of each contact's points along each other up to the middle
  for (const RowGroup& c : rows.group) {
    double rate[kMaxRows], load[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    gather(rows, c, data.smooth_acceleration.data(), load);
    for (int i = 0; i < c.dim; ++i) rate[i] = 0.5 * length * (rate[i] + 0.25 * length * load[i]);
    if (c.kind == RowKind::kContact) {
      contacts[c.input].gap -= rate[0];
      way.push_back(c.dim > 1 ? std::hypot(rate[0], rate[1], rate[2]) : std::abs(rate[0]));
      continue;
    }
    ConstraintInput& constraint = constraints[c.input];
    constraint.position -= rate[0];
    for (const ConstraintInput& same : start_constraints)
      if (same.memory == constraint.memory) constraint.position = same.position;
  }
  take_gaps_at_start(start, way, contacts);
}

// A rigid contact under impact is a spring whose contact time is about a part, so that the part
// resolves it; one that is compressed keeps its spring. What rigid means is thus the limit of ever
// stiffer springs with the same damping ratio.
void Stepper::Impl::give_rigid_impacts_springs(mjData_* d, const std::vector<GeomPair>& impact) {
  std::map<GeomPair, double> compressed;
  const Memory view = memory(d);
  for (int i = 0; i < view.contact_count(); ++i) {
    const RememberedContact contact = view.contact(i);
    double& stiffness = compressed[{int(contact.geom[0]), int(contact.geom[1])}];
    stiffness = std::max(stiffness, contact.stiffness);
  }
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact || !materials[i].rigid()) continue;
    const GeomPair& pair = contacts[c.input].geom;
    if (!std::binary_search(impact.begin(), impact.end(), pair)) continue;
    const auto before = compressed.find(pair);
    make_impact_spring(materials[i].material, rows.inverse_mass[c.row], length,
                       before == compressed.end() ? 0.0 : before->second);
  }
}

// Velocities and inertia as the geometry of the middle sees them.
void Stepper::Impl::freeze_at_middle(const mjData_* d) {
  host::find_effective_inertia(model, d, trees, inertia_factor);
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    const Tree& tree = trees.tree[index];
    double* acceleration = smooth_acceleration.data() + tree.dof_begin;
    Vector6 of_free_body;
    const double* velocity = start_velocity.data() + tree.dof_begin;
    inverted[index] = tree.free_body;
    if (moves_as_free_body(index)) {
      FreeMotion& motion = free_motion[index];
      freeze_at(motion, host::orientation(model, d, index));
      Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
      of_free_body = dashpot::start_velocity(motion);
      velocity = of_free_body.data();
    }
    to_coordinates(index, acceleration, data.smooth_acceleration.data() + tree.begin);
    to_coordinates(index, velocity, data.velocity.data() + tree.begin);
  }
}

void Stepper::Impl::read_state(const mjData_* d) {
  const double* q = host::position(d);
  const double* v = host::velocity(d);
  start_position.assign(q, q + host::position_count(model));
  start_velocity.assign(v, v + host::dof_count(model));
}

void Stepper::Impl::append_constraint(int index, mjData_* d) {
  const ConstraintInput& input = constraints[index];
  const RowGroup& c = rows.append(input.kind, index, 1, input.tree);
  rows.friction[c.row] = input.limit;
  host::typical_inverse_mass(d, input, rows.typical_inverse_mass.data() + c.row);
  materials.push_back(material_of(input));
  host::append_jacobian(model, d, input, trees, rows);
  invert_inertia_of(c.tree);
  find_inverse_mass(rows, c, trees);
}

void Stepper::Impl::append_contact(int index, mjData_* d) {
  const ContactInput& input = contacts[index];
  const RowGroup& c = rows.append(RowKind::kContact, index, input.dim, input.tree);
  host::typical_inverse_mass(model, d, input, rows.typical_inverse_mass.data() + c.row);
  materials.push_back(material_of(model, parameters, input));
  const Material& material = materials.back().material;
  std::array<double, 5> friction = input.friction;
  const int coefficient[5] = {0, 0, 1, 2, 2};
  for (int i = 0; i < 5; ++i) {
    const double overriding = material.friction[coefficient[i]];
    if (material.has_friction && !std::isnan(overriding)) friction[i] = overriding;
  }
  std::copy_n(friction.begin(), c.dim - 1, rows.friction.begin() + c.row + 1);
  host::append_jacobian(model, d, input, trees, rows);
  invert_inertia_of(c.tree);
  find_inverse_mass(rows, c, trees);
}

// Trees that no row touches never need the inverse of their inertia.
void Stepper::Impl::invert_inertia_of(const std::array<int, 2>& tree) {
  for (int index : tree) {
    if (index < 0 || inverted[index]) continue;
    invert_inertia(trees, index, inertia_factor.data() + trees.tree[index].inverse);
    inverted[index] = 1;
  }
}

// The complementarity-free law leaves every tree to MuJoCo's semi-implicit integrator.
bool Stepper::Impl::moves_as_free_body(int tree) const {
  return parameters.options.law != Law::kComFree && host::is_free_body(model, tree);
}

// Implicit in velocity as the integrator is; free bodies get the mean of their accurate motion.
void Stepper::Impl::find_smooth_acceleration(mjData_* d, bool rough) {
  host::prepare_effective_inertia(model, d);
  host::find_effective_inertia(model, d, trees, inertia_factor);
  data.reset_motion(trees.coordinates);
  free_motion.resize(trees.tree.size());
  smooth_acceleration.resize(start_velocity.size());
  inverted.resize(trees.tree.size());
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    const Tree& tree = trees.tree[index];
    double* acceleration = smooth_acceleration.data() + tree.dof_begin;
    inverted[index] = tree.free_body;
    host::smooth_acceleration(d, trees, index, inertia_factor, acceleration);
    if (host::is_free_body(model, index)) {
      FreeMotion& motion = free_motion[index];
      motion =
          predict_free_motion(host::read_free_body(model, d, index, acceleration), length, rough);
      if (moves_as_free_body(index))
        Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
    }
    to_coordinates(index, acceleration, data.smooth_acceleration.data() + tree.begin);
    to_coordinates(index, start_velocity.data() + tree.dof_begin,
                   data.velocity.data() + tree.begin);
  }
  for (size_t i = 0; i < smooth_acceleration.size(); ++i)
    if (!(std::abs(smooth_acceleration[i]) <= host::kLargestValue))
      throw std::runtime_error("smooth acceleration of degree of freedom " + std::to_string(i) +
                               " diverged; data are as they were before the step");
}

void Stepper::Impl::to_coordinates(int index, const double* generalized,
                                   double* coordinates) const {
  const Tree& tree = trees.tree[index];
  if (!tree.free_body) {
    std::copy_n(generalized, tree.dof_count, coordinates);
    return;
  }
  const Vector6 centre =
      motion_of_centre(free_motion[index], Eigen::Map<const Vector6>(generalized));
  std::copy_n(centre.data(), 3, coordinates);
  std::copy_n(centre.data() + 3, 3, coordinates + 4);
}

void Stepper::Impl::to_generalized(int index, const double* coordinates,
                                   double* generalized) const {
  const Tree& tree = trees.tree[index];
  if (!tree.free_body)
    std::copy_n(coordinates, tree.dof_count, generalized);
  else
    Eigen::Map<Vector6>{generalized} = motion_of_origin(free_motion[index], of_body(coordinates));
}

void Stepper::Impl::build_rows(mjData_* d) {
  if (static_cast<int>(contacts.size()) > memory_layout.contacts)
    throw std::runtime_error(std::to_string(contacts.size()) + " contacts exceed the memory for " +
                             std::to_string(memory_layout.contacts) +
                             " contacts that data reserve");
  int count = static_cast<int>(constraints.size());
  for (const ContactInput& contact : contacts) count += contact.dim;
  rows.reset(count);
  materials.clear();
  for (size_t i = 0; i < constraints.size(); ++i) append_constraint(static_cast<int>(i), d);
  for (size_t i = 0; i < contacts.size(); ++i) append_contact(static_cast<int>(i), d);
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  start_motion = data.velocity;
  islands.find(rows, trees);
  find_sag_times();
  islands.plan(rows, trees, materials, sag_time, length, parameters.options);
  Memory view = memory(d);
  view.recall(contacts, constraints, rows, parameters.options.recovery_speed, data);
  if (!part.impact.empty() && !std::isinf(parameters.options.recovery_speed))
    view.limit_compression(part.impact, contacts, rows, data);
  ledger = view.ledger();
}

void Stepper::Impl::find_sag_times() {
  const double gravity = host::gravity(model);
  sag_time.assign(rows.group.size(), std::numeric_limits<double>::infinity());
  if (gravity == 0.0) return;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact || c.tree[0] < 0 || c.tree[1] < 0) continue;
    sag_time[i] = std::sqrt(kRigidSag * host::contact_radius(model, contacts[c.input]) / gravity);
  }
}

void Stepper::Impl::run_islands() {
  const EnergyShares before = elastic_energy(rows, data);
  for (const Island& island : islands.all())
    if (!stays_apart(rows, island, length, data))
      microsteps.run(rows, trees, island, parameters.options.recovery_speed, data);
  check_finite();
  update_ledger(before, elastic_energy(rows, data));
  recovery_displacement.assign(trees.coordinates, 0.0);
  for (const Island& island : islands.all())
    ledger.dissipated_recovery -=
        recover_positions(rows, trees, island, parameters.options.recovery_speed, length, data,
                          recovery_displacement);
  ledger.elastic = elastic_energy(rows, data).sum();
  for (int i = 0; i < trees.coordinates; ++i)
    data.total_displacement[i] += recovery_displacement[i];
  find_touched_trees();
}

// Nothing is remembered but the ledger, and no spring stores energy.
void Stepper::Impl::update_complementarity_free(mjData_* d) {
  data.reset_rows(rows);
  start_motion = data.velocity;
  islands.find(rows, trees);
  ledger = memory(d).ledger();
  std::vector<double> gap, mass;
  for (const RowGroup& c : rows.group) {
    // Equalities and dry friction loss can enter by edits of the model.
    if (c.kind == RowKind::kBilateral || c.kind == RowKind::kSlider)
      host::check_supported(model, parameters.options.law);
    const bool contact = c.kind == RowKind::kContact;
    gap.push_back(contact ? contacts[c.input].gap : constraints[c.input].position);
    mass.push_back(effective_mass(
        impedance(contact ? contacts[c.input].solimp : constraints[c.input].solimp, gap.back()),
        rows.typical_inverse_mass[c.row]));
  }
  const ComFree law{parameters.options.comfree_stiffness, parameters.options.comfree_damping};
  dashpot::update_complementarity_free(law, rows, trees, gap, mass, length, data);
  check_finite();
  find_touched_trees();
  update_ledger({}, {});
}

void Stepper::Impl::find_touched_trees() {
  touched.assign(trees.tree.size(), 0);
  held.assign(trees.tree.size(), 0);
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
  return overlaps_semi_implicitly(rows, c, gap, start_motion.data(),
                                  data.smooth_acceleration.data(), length);
}

void Stepper::Impl::check_finite() const {
  for (const Tree& tree : trees.tree)
    for (int i = 0; i < tree.count; ++i)
      if (!(std::abs(data.velocity[tree.begin + i]) <= host::kLargestValue))
        throw std::runtime_error(
            "contact forces diverged at the kinematic tree of degree of freedom " +
            std::to_string(tree.dof_begin) + "; data are as they were before the step");
}

// Elastic energy that memory did not bring back, and work of the recovering surface, count as
// recovery; what the rows took from the bodies and did not store was dissipated.
void Stepper::Impl::update_ledger(const EnergyShares& before, const EnergyShares& after) {
  ledger.dissipated_recovery += ledger.elastic - before.sum() - data.recovery_input.sum();
  ledger.dissipated_normal +=
      data.recovery_input.normal - data.work.normal - (after.normal - before.normal);
  ledger.dissipated_friction -= data.work.friction + (after.friction - before.friction);
  ledger.dissipated_constraint += data.recovery_input.constraint - data.work.constraint -
                                  (after.constraint - before.constraint);
  ledger.elastic = after.sum();
}

void Stepper::Impl::report_forces(mjData_* d) {
  constraint_force.assign(start_velocity.size(), 0.0);
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    if (!touched[index]) continue;
    const Tree& tree = trees.tree[index];
    const double* impulse = data.coordinate_impulse.data() + tree.begin;
    double* force = constraint_force.data() + tree.dof_begin;
    if (tree.free_body)
      Eigen::Map<Vector6>{force} = generalized_force(free_motion[index], of_body(impulse));
    else
      std::copy_n(impulse, tree.dof_count, force);
  }
  for (double& force : constraint_force) force /= length;
  row_force = data.total_impulse;
  for (double& force : row_force) force /= length;
  host::report_forces(model, d, constraint_force, contacts, constraints, rows, row_force);
}

void Stepper::Impl::advance_state(mjData_* d) {
  host::integrate(model, d);
  if (parameters.options.law == Law::kComFree) return;
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index)
    if (touched[index] || host::is_free_body(model, index)) advance_tree(d, index);
}

// Work that rows did on a free body, in the frozen geometry: its gain of kinetic energy less the
// work of the smooth load.
double Stepper::Impl::contact_work(int index) const {
  const Tree& tree = trees.tree[index];
  const auto centre = [&](const AlignedDoubles& coordinates) -> Vector6 {
    const double* own = coordinates.data() + tree.begin;
    if (tree.free_body) return of_body(own);
    return motion_of_centre(free_motion[index], Eigen::Map<const Vector6>(own));
  };
  const Vector6 twice_mean = centre(start_motion) + centre(data.velocity);
  const Vector6 load = wrench_of(free_motion[index], centre(data.smooth_acceleration));
  double work = load.dot(0.5 * length * twice_mean - centre(data.total_displacement));
  for (int i = tree.begin; i < tree.begin + tree.count; ++i)
    work += 0.5 * data.coordinate_impulse[i] * (start_motion[i] + data.velocity[i]);
  return work;
}

// Seen from the geometry of the middle, a body's inertia differs a little from what it is at the
// start and at the end. What this would add to its energy is taken out of its rotation.
void Stepper::Impl::advance_tree(mjData_* d, int index) {
  const Tree& tree = trees.tree[index];
  const double* moved = data.total_displacement.data() + tree.begin;
  const double* end_velocity = data.velocity.data() + tree.begin;
  if (!host::is_free_body(model, index)) {
    // Dry friction has no position to keep, so it leaves the stability of the semi-implicit update.
    if (!held[index]) {
      displacement.assign(end_velocity, end_velocity + tree.dof_count);
      for (double& way : displacement) way *= length;
      moved = displacement.data();
    }
    host::write_tree(model, d, tree, start_position.data(), moved, end_velocity);
    return;
  }
  const FreeMotion& motion = free_motion[index];
  Vector6 velocity_change = Vector6::Zero(), shift = Vector6::Zero();
  if (touched[index]) {
    // What contacts added to the smooth motion.
    double change[kBodyCoordinates], move[kBodyCoordinates];
    const double* velocity = start_motion.data() + tree.begin;
    const double* acceleration = data.smooth_acceleration.data() + tree.begin;
    for (int i = 0; i < tree.count; ++i) {
      change[i] = end_velocity[i] - velocity[i] - length * acceleration[i];
      move[i] = moved[i] - length * (velocity[i] + 0.5 * length * acceleration[i]);
    }
    velocity_change = of_body(change);
    shift = of_body(move);
    if (!tree.free_body) {
      velocity_change = motion_of_centre(motion, Eigen::Map<const Vector6>(change));
      shift = motion_of_centre(motion, Eigen::Map<const Vector6>(move));
    }
  }
  FreeBody end = finish_free_motion(motion, length, velocity_change, shift);
  if (touched[index] && geometry_of_middle) {
    const double excess = energy_gain(motion, length, end) - contact_work(index);
    if (excess > 0.0) brake_rotation(end, excess);
  }
  host::write_free_body(model, d, index, end);
}

// Trees that rows moved went the integral of their velocity and what recovery displaced them; the
// change of kinetic energy of all others goes with their mean velocity.
void Stepper::Impl::account_smooth_work(mjData_* d) {
  const double* velocity = host::velocity(d);
  mean_displacement.resize(start_velocity.size());
  for (size_t i = 0; i < start_velocity.size(); ++i)
    mean_displacement[i] = 0.5 * length * (start_velocity[i] + velocity[i]);
  if (parameters.options.law != Law::kComFree) {
    recovered.assign(start_velocity.size(), 0.0);
    for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
      if (!touched[index]) continue;
      const Tree& tree = trees.tree[index];
      double* mean = mean_displacement.data() + tree.dof_begin;
      double* shift = recovered.data() + tree.dof_begin;
      to_generalized(index, data.total_displacement.data() + tree.begin, mean);
      to_generalized(index, recovery_displacement.data() + tree.begin, shift);
      for (int i = 0; i < tree.dof_count; ++i) mean[i] -= shift[i];
    }
    ledger.dissipated_recovery += host::potential_work(model, d, recovered.data());
  }
  const host::SmoothWork work =
      host::smooth_work(model, d, start_velocity.data(), mean_displacement.data());
  ledger.dissipated_damping -= work.damping;
  ledger.work += work.applied;
  for (const RowGroup& c : rows.group)
    ledger.work += surface_work(rows, c, data.total_impulse.data() + c.row);
}

void Stepper::Impl::remember(mjData_* d) {
  Memory view = memory(d);
  view.remember(contacts, constraints, rows, data);
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

StepStats Stepper::step(mjData_* data, int nstep, bool leave_rows) {
  StepStats total;
  for (int i = 0; i < nstep; ++i)
    accumulate(impl_->step(data, leave_rows && i == nstep - 1), total);
  return total;
}

}  // namespace dashpot
