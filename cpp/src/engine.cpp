#include "dashpot/engine.hpp"

#include <algorithm>
#include <cmath>
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
#include "dashpot/row_products.hpp"
#include "dashpot/rows.hpp"

namespace dashpot {

namespace {

// A contact or constraint that no material covers: rigid, or what the model's own solref means.
template <typename Input>
GroupMaterial from_solref(const Input& input) {
  GroupMaterial given;
  if (!input.has_solref) return given;
  const auto [stiffness, damping] =
      solref_to_spring(input.solref[0], input.solref[1], input.solimp[1]);
  given.mass_normalised = true;
  given.normalised_stiffness = stiffness;
  given.normalised_damping = damping;
  return given;
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
  StepStats step(mjData_* d);
  void advance(mjData_* d, host::StepParts& parts);

  // The stages of a step (DESIGN section 2).
  void read_state(const mjData_* d);
  void find_smooth_acceleration(mjData_* d, bool rough = false);
  Part cut_at_impact(mjData_* d, host::StepParts& parts);
  void build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart);
  void give_rigid_impacts_springs(mjData_* d, const std::vector<GeomPair>& impact);
  void freeze_at_middle(const mjData_* d);
  void build_rows(mjData_* d);
  void plan_and_recall(mjData_* d);
  void run_islands();
  void update_complementarity_free(mjData_* d);
  void report_forces(mjData_* d);
  void advance_state(mjData_* d);
  void account_smooth_work(mjData_* d);
  void remember(mjData_* d);

  GroupMaterial material_of(const ContactInput& input) const;
  void append_constraint(int index, mjData_* d);
  void append_contact(int index, mjData_* d);
  bool moves_as_free_body(int tree) const;
  void collect_impulses(const std::vector<double>& start);
  bool lands_in_next_step(const RowGroup& c, const std::vector<double>& start) const;
  void check_finite() const;
  void update_ledger(const EnergyShares& before, const EnergyShares& after);
  double contact_work(const Tree& tree) const;
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
  bool geometry_of_middle = false;  // of the part, not of its start
  std::vector<double> start_position, start_velocity;
  Trees trees;
  std::vector<ContactInput> contacts;
  std::vector<ConstraintInput> constraints;
  std::vector<GroupMaterial> materials;  // per group
  Rows rows;
  RowData data;
  std::vector<Island> islands;
  std::vector<FreeMotion> free_motion;        // by tree; meaningful for free bodies
  std::vector<double> smooth_acceleration;    // generalized
  std::vector<double> contact_impulse;        // whitened, over the whole step
  std::vector<char> touched;                  // by tree: rows moved it
  std::vector<char> held;                     // by tree: rows that have a position moved it
  std::vector<double> mean_displacement;      // generalized
  std::vector<double> recovery_displacement;  // whitened, of equalities
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

StepStats Stepper::Impl::step(mjData_* d) {
  host::check_options(model, parameters.options.law);
  host::check_data(model, d, data_size);
  host::StepParts parts(model, d);
  cuts = 0;
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
  host::detect(model, d, smooth_acceleration, contacts, constraints);
  Part part;
  if (parameters.options.impact == Impact::kCut) part = cut_at_impact(d, parts);
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
}

// Ends this part of the step where the next impact begins.
Part Stepper::Impl::cut_at_impact(mjData_* d, host::StepParts& parts) {
  Part part;
  if (cuts == kMaxCuts) return part;
  part = part_before_impact(model, d, memory(d), smooth_acceleration, constraints, contacts,
                            parts.whole(), length, kMaxCuts - cuts);
  drop_pairs(part.apart, contacts);
  if (part.length != length) {
    ++cuts;
    length = part.length;
    parts.set_length(length);
  }
  return part;
}

void Stepper::Impl::build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart) {
  const std::vector<ContactInput> start = contacts;
  const std::vector<ConstraintInput> start_constraints = constraints;
  const host::MiddleGeometry middle(model, d, smooth_acceleration, contacts, constraints);
  drop_pairs(apart, contacts);
  freeze_at_middle(d);
  build_rows(d);
  std::vector<double> way;  // m, of each contact's points along each other up to the middle
  for (const RowGroup& c : rows.group) {
    double rate[kMaxRows], load[kMaxRows];
    const double* jacobian = rows.jacobian.data() + c.jacobian;
    gather(jacobian, c, data.velocity.data(), rate);
    gather(jacobian, c, data.smooth_acceleration.data(), load);
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
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    host::factor_tree(model, d, trees, index);
    const int begin = trees.tree[index].dof_begin;
    double* acceleration = smooth_acceleration.data() + begin;
    Vector6 velocity;
    const double* start = start_velocity.data() + begin;
    if (moves_as_free_body(index)) {
      FreeMotion& motion = free_motion[index];
      freeze_at(motion, host::orientation(model, d, index));
      Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
      velocity = dashpot::start_velocity(motion);
      start = velocity.data();
    }
    whiten_velocity(trees, index, acceleration, data.smooth_acceleration.data() + begin);
    whiten_velocity(trees, index, start, data.velocity.data() + begin);
  }
}

void Stepper::Impl::read_state(const mjData_* d) {
  const double* q = host::position(d);
  const double* v = host::velocity(d);
  start_position.assign(q, q + host::position_count(model));
  start_velocity.assign(v, v + host::dof_count(model));
}

GroupMaterial Stepper::Impl::material_of(const ContactInput& input) const {
  const auto [low, high] = std::minmax(input.geom[0], input.geom[1]);
  const auto pair = parameters.pair_material.find({low, high});
  if (pair != parameters.pair_material.end()) return {pair->second};
  Material side[2];
  for (int i = 0; i < 2; ++i) {
    const bool flex = input.geom[i] < 0;
    if (flex)
      side[i].from_model = true;
    else
      side[i] = parameters.geom_material[input.geom[i]];
  }
  if (side[0].from_model && side[1].from_model) return from_solref(input);
  const bool overridden = side[0].has_friction || side[1].has_friction;
  if (overridden)
    for (int i = 0; i < 2; ++i) {
      const std::array<double, 3> own = host::geom_friction(model, input.geom[i]);
      for (size_t j = 0; j < own.size(); ++j)
        if (!side[i].has_friction || std::isnan(side[i].friction[j])) side[i].friction[j] = own[j];
      side[i].has_friction = true;
    }
  // A side that nobody set has no damping of its own to mix in.
  for (int i = 0; i < 2; ++i)
    if (side[i].from_model) {
      side[i].form = side[1 - i].form;
      side[i].damping = side[1 - i].damping;
    }
  Material combined = combine(side[0], side[1], parameters.options.rules);
  // Rigid rows tell a restitution, of one contact, from a damping ratio, of a coupled mode.
  if (combined.rigid && side[0].form == DampingForm::kRestitution &&
      side[1].form == DampingForm::kRestitution) {
    combined.form = DampingForm::kRestitution;
    combined.damping = damping_ratio_to_restitution(combined.damping);
  }
  const int priority[2] = {host::geom_priority(model, input.geom[0]),
                           host::geom_priority(model, input.geom[1])};
  if (priority[0] != priority[1]) combined.friction = side[priority[1] > priority[0]].friction;
  return {combined};
}

void Stepper::Impl::append_constraint(int index, mjData_* d) {
  const ConstraintInput& input = constraints[index];
  const RowGroup& c = rows.append(input.kind, index, 1, trees, input.tree);
  rows.friction[c.row] = input.limit;
  host::typical_inverse_mass(d, input, rows.typical_inverse_mass.data() + c.row);
  host::fill_jacobian(model, d, input, c, trees, rows.jacobian.data() + c.jacobian);
  whiten(rows, c, trees);
  materials.push_back(from_solref(input));
}

void Stepper::Impl::append_contact(int index, mjData_* d) {
  const ContactInput& input = contacts[index];
  const RowGroup& c = rows.append(RowKind::kContact, index, input.dim, trees, input.tree);
  host::typical_inverse_mass(d, input, rows.typical_inverse_mass.data() + c.row);
  materials.push_back(material_of(input));
  const Material& material = materials.back().material;
  std::array<double, 5> friction = input.friction;
  const int coefficient[5] = {0, 0, 1, 2, 2};
  for (int i = 0; i < 5; ++i) {
    const double overriding = material.friction[coefficient[i]];
    if (material.has_friction && !std::isnan(overriding)) friction[i] = overriding;
  }
  std::copy_n(friction.begin(), c.dim - 1, rows.friction.begin() + c.row + 1);
  host::fill_jacobian(model, d, input, c, trees, rows.jacobian.data() + c.jacobian);
  whiten(rows, c, trees);
}

// The complementarity-free law leaves every tree to MuJoCo's semi-implicit integrator.
bool Stepper::Impl::moves_as_free_body(int tree) const {
  return parameters.options.law != Law::kComFree && host::is_free_body(model, tree);
}

// Implicit in velocity as the integrator is; free bodies get the mean of their accurate motion.
void Stepper::Impl::find_smooth_acceleration(mjData_* d, bool rough) {
  host::prepare_effective_inertia(model, d);
  data.reset_motion(host::dof_count(model));
  free_motion.resize(trees.tree.size());
  smooth_acceleration.assign(start_velocity.size(), 0.0);
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    host::factor_tree(model, d, trees, index);
    const int begin = trees.tree[index].dof_begin;
    double* acceleration = smooth_acceleration.data() + begin;
    double* whitened = data.smooth_acceleration.data() + begin;
    whiten_force(trees, index, host::smooth_force(d) + begin, whitened);
    unwhiten_velocity(trees, index, whitened, acceleration);
    if (moves_as_free_body(index)) {
      FreeMotion& motion = free_motion[index];
      motion =
          predict_free_motion(host::read_free_body(model, d, index, acceleration), length, rough);
      Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
      whiten_velocity(trees, index, acceleration, whitened);
    }
    whiten_velocity(trees, index, start_velocity.data() + begin, data.velocity.data() + begin);
  }
  for (size_t i = 0; i < smooth_acceleration.size(); ++i)
    if (!(std::abs(smooth_acceleration[i]) <= host::kLargestValue))
      throw std::runtime_error("smooth acceleration of degree of freedom " + std::to_string(i) +
                               " diverged; data are as they were before the step");
}

void Stepper::Impl::build_rows(mjData_* d) {
  if (static_cast<int>(contacts.size()) > memory_layout.contacts)
    throw std::runtime_error(std::to_string(contacts.size()) + " contacts exceed the memory for " +
                             std::to_string(memory_layout.contacts) +
                             " contacts that data reserve");
  rows.clear();
  materials.clear();
  for (size_t i = 0; i < constraints.size(); ++i) append_constraint(static_cast<int>(i), d);
  for (size_t i = 0; i < contacts.size(); ++i) append_contact(static_cast<int>(i), d);
}

void Stepper::Impl::plan_and_recall(mjData_* d) {
  data.reset_rows(rows);
  islands = find_islands(rows, trees);
  for (Island& island : islands)
    plan_microsteps(island, rows, trees, materials, length, parameters.options);
  const Memory view = memory(d);
  view.recall(contacts, constraints, rows, parameters.options.recovery_speed, data);
  ledger = view.ledger();
}

void Stepper::Impl::run_islands() {
  const EnergyShares before = elastic_energy(rows, data);
  const std::vector<double> start = data.velocity;
  for (const Island& island : islands)
    if (!stays_apart(rows, island, length, data))
      run_microsteps(rows, trees, island, parameters.options.recovery_speed, data);
  update_ledger(before, elastic_energy(rows, data));
  recovery_displacement.assign(start.size(), 0.0);
  for (const Island& island : islands)
    ledger.dissipated_recovery -=
        recover_positions(rows, trees, island, parameters.options.recovery_speed, length, data,
                          recovery_displacement);
  ledger.elastic = elastic_energy(rows, data).sum();
  for (size_t i = 0; i < start.size(); ++i) data.total_displacement[i] += recovery_displacement[i];
  collect_impulses(start);
}

// Nothing is remembered but the ledger, and no spring stores energy.
void Stepper::Impl::update_complementarity_free(mjData_* d) {
  data.reset_rows(rows);
  islands = find_islands(rows, trees);
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
  const std::vector<double> start = data.velocity;
  const ComFree law{parameters.options.comfree_stiffness, parameters.options.comfree_damping};
  dashpot::update_complementarity_free(law, rows, gap, mass, length, data);
  collect_impulses(start);
  update_ledger({}, {});
}

// The motion that rows caused, and the trees it reached.
void Stepper::Impl::collect_impulses(const std::vector<double>& start) {
  check_finite();
  contact_impulse.resize(start.size());
  for (size_t i = 0; i < start.size(); ++i)
    contact_impulse[i] = data.velocity[i] - start[i] - length * data.smooth_acceleration[i];
  touched.assign(trees.tree.size(), 0);
  held.assign(trees.tree.size(), 0);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!data.touched[i] && !lands_in_next_step(c, start)) continue;
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
bool Stepper::Impl::lands_in_next_step(const RowGroup& c, const std::vector<double>& start) const {
  if (parameters.options.law == Law::kComFree) return false;
  const double gap =
      c.kind == RowKind::kContact ? contacts[c.input].gap : constraints[c.input].position;
  return overlaps_semi_implicitly(rows, c, gap, start.data(), data.smooth_acceleration.data(),
                                  length);
}

void Stepper::Impl::check_finite() const {
  for (size_t i = 0; i < data.velocity.size(); ++i)
    if (!(std::abs(data.velocity[i]) <= host::kLargestValue))
      throw std::runtime_error("contact forces diverged at degree of freedom " + std::to_string(i) +
                               "; data are as they were before the step");
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
  std::vector<double> constraint_force(start_velocity.size(), 0.0);
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    if (!touched[index]) continue;
    const int begin = trees.tree[index].dof_begin;
    generalized_impulse(trees, index, contact_impulse.data() + begin,
                        constraint_force.data() + begin);
  }
  for (double& force : constraint_force) force /= length;
  std::vector<double> row_force = data.total_impulse;
  for (double& force : row_force) force /= length;
  host::report_forces(model, d, constraint_force, contacts, constraints, rows, row_force);
}

void Stepper::Impl::advance_state(mjData_* d) {
  host::integrate(model, d);
  if (parameters.options.law == Law::kComFree) return;
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index)
    if (touched[index] || host::is_free_body(model, index)) advance_tree(d, index);
}

// Work that rows did on a tree, in the frozen geometry: its gain less the work of the smooth load.
double Stepper::Impl::contact_work(const Tree& tree) const {
  double work = 0.0;
  for (int i = tree.dof_begin; i < tree.dof_begin + tree.dof_count; ++i) {
    const double a = data.smooth_acceleration[i], end = data.velocity[i];
    const double start = end - contact_impulse[i] - length * a;
    work += 0.5 * (end - start) * (end + start) - a * data.total_displacement[i];
  }
  return work;
}

// Seen from the geometry of the middle, a body's inertia differs a little from what it is at the
// start and at the end. What this would add to its energy is taken out of its rotation.
void Stepper::Impl::advance_tree(mjData_* d, int index) {
  const Tree& tree = trees.tree[index];
  const int begin = tree.dof_begin, count = tree.dof_count;
  if (host::is_free_body(model, index)) {
    Vector6 velocity_change = Vector6::Zero(), displacement = Vector6::Zero();
    if (touched[index]) {
      Vector6 whitened;
      for (int i = 0; i < 6; ++i)
        whitened[i] = data.total_displacement[begin + i] -
                      length * (data.velocity[begin + i] - contact_impulse[begin + i]) +
                      0.5 * length * length * data.smooth_acceleration[begin + i];
      unwhiten_velocity(trees, index, whitened.data(), displacement.data());
      unwhiten_velocity(trees, index, contact_impulse.data() + begin, velocity_change.data());
    }
    FreeBody end = finish_free_motion(free_motion[index], length, velocity_change, displacement);
    if (touched[index] && geometry_of_middle) {
      const double excess = energy_gain(free_motion[index], length, end) - contact_work(tree);
      if (excess > 0.0) brake_rotation(end, excess);
    }
    host::write_free_body(model, d, index, end);
    return;
  }
  std::vector<double> displacement(count), velocity(count);
  unwhiten_velocity(trees, index, data.velocity.data() + begin, velocity.data());
  // Dry friction has no position to keep, so it leaves the stability of the semi-implicit update.
  if (held[index])
    unwhiten_velocity(trees, index, data.total_displacement.data() + begin, displacement.data());
  else
    for (int i = 0; i < count; ++i) displacement[i] = length * velocity[i];
  host::write_tree(model, d, tree, start_position.data(), displacement.data(), velocity.data());
}

// Trees that rows moved went the integral of their velocity and what recovery displaced them; the
// change of kinetic energy of all others goes with their mean velocity.
void Stepper::Impl::account_smooth_work(mjData_* d) {
  const double* velocity = host::velocity(d);
  mean_displacement.resize(start_velocity.size());
  for (size_t i = 0; i < start_velocity.size(); ++i)
    mean_displacement[i] = 0.5 * length * (start_velocity[i] + velocity[i]);
  if (parameters.options.law != Law::kComFree) {
    std::vector<double> recovered(start_velocity.size(), 0.0);
    for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
      if (!touched[index]) continue;
      const Tree& tree = trees.tree[index];
      double* mean = mean_displacement.data() + tree.dof_begin;
      double* shift = recovered.data() + tree.dof_begin;
      unwhiten_velocity(trees, index, data.total_displacement.data() + tree.dof_begin, mean);
      unwhiten_velocity(trees, index, recovery_displacement.data() + tree.dof_begin, shift);
      for (int i = 0; i < tree.dof_count; ++i) mean[i] -= shift[i];
    }
    ledger.dissipated_recovery += host::potential_work(model, d, recovered.data());
  }
  const host::SmoothWork work =
      host::smooth_work(model, d, start_velocity.data(), mean_displacement.data());
  ledger.dissipated_damping -= work.damping;
  ledger.work += work.applied;
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
  stats.islands = static_cast<int>(islands.size());
  for (const Island& island : islands) {
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

StepStats Stepper::step(mjData_* data, int nstep) {
  StepStats total;
  for (int i = 0; i < nstep; ++i) accumulate(impl_->step(data), total);
  return total;
}

}  // namespace dashpot
