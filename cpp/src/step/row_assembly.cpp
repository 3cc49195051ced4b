// The rows of a step: what detection found, with materials, Jacobians and inverse masses.

#include <algorithm>
#include <cmath>

#include "dashpot/lanes/prefetch.hpp"
#include "dashpot/model/jacobians.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/rows/mass_weighted.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Weights that a soft contact bears: more than piles, grips and motion at a few g ask for.
constexpr double kSoftLoad = 100.0;
constexpr int kGroupsAtOnce = 32;  // by a thread

// Weight (N) of the lighter tree of a contact. Without gravity that which it has on earth.
double weight_at_contact(const mjModel_* model, const ContactInput& input, double inverse_mass) {
  const double mass = host::contact_mass(model, input);
  return host::usual_gravity(model) * (std::isinf(mass) ? 1.0 / inverse_mass : mass);
}

void prefetch_inertia(const Trees& trees, const std::array<int, 2>& tree) {
  for (int index : tree) {
    if (index < 0 || !trees.tree[index].free_body) continue;
    prefetch(trees.inverse.data() + trees.tree[index].inverse, 4 * sizeof(Lanes));
  }
}

// Limits of both ends of a range follow one another, and come before all contacts.
void mark_ends_of_ranges(const std::vector<ConstraintInput>& constraints, Rows& rows) {
  for (size_t i = 1; i < constraints.size(); ++i) {
    const ConstraintInput &one = constraints[i - 1], &other = constraints[i];
    if (!one.is_joint_limit || !other.is_joint_limit) continue;
    RowGroup &a = rows.group[i - 1], &b = rows.group[i];
    // With margins wider than the range both ends are pressed at once.
    if (a.is_of_one_coordinate(0) && b.is_of_one_coordinate(0) &&
        rows.column[a.column] == rows.column[b.column] && one.position + other.position > 0.0)
      a.is_end_of_range = b.is_end_of_range = true;
  }
}

// Groups of all contacts, with room for the rows of those that have no pair geometry.
void append_contacts(const mjModel_* model, const mjData_* data,
                     const std::vector<ContactInput>& contacts, TreeMotion& motion, Rows& rows) {
  const Trees& trees = motion.trees();
  int pairs = 0;
  for (size_t i = 0; i < contacts.size(); ++i) {
    const ContactInput& input = contacts[i];
    RowGroup& c = rows.append(RowKind::kContact, static_cast<int>(i), input.dim, input.tree);
    if (rows.weighs(c)) motion.ask_for_inverse(c.tree);
    if (host::has_pair_geometry(model, data, input, trees)) {
      c.pair = pairs++;
      continue;
    }
    host::append_columns(model, data, input, trees, rows);
    if (rows.weighs(c)) append_mass_weighted(rows, c, trees);
  }
  rows.pair.resize(pairs);  // filled by fill_contact()
}

// All else of a contact's group, which depends on no other.
void fill_contact(const mjModel_* model, const mjData_* data, const Parameters& parameters,
                  const ContactInput& input, const Trees& trees, Rows& rows, RowGroup& c,
                  GroupMaterial& given) {
  const double typical = host::typical_inverse_mass(model, data, input);
  const double weight = weight_at_contact(model, input, typical);
  // A contact's own solref is read at the load A F of the weight F: g for a free body.
  given = material_of(model, parameters, input, typical * weight);
  if (given.has_si_stiffness()) c.soft_load = kSoftLoad * weight;
  const Material& material = given.material;
  c.loaded_friction = material.loaded_friction;
  c.friction_load = material.friction_load;
  c.ahead = input.ahead;
  c.turning = input.turning;
  c.surface_acceleration = along_frame(input, input.surface_acceleration);
  for (int i = 0; i < 3; ++i) c.turning[i] += c.surface_acceleration[i];
  c.is_of_round_hit = input.is_of_round_hit;
  const std::array<double, 5> friction = friction_of(input, material);
  std::copy_n(friction.begin(), c.dim - 1, rows.friction.begin() + c.row + 1);
  host::typical_inverse_masses(model, data, input, friction,
                               rows.typical_inverse_mass.data() + c.row);
  if (c.pair >= 0)
    rows.pair[c.pair] = host::pair_geometry(model, data, input, trees);
  else
    host::fill_jacobian(model, data, input, trees, c, rows);
  if (rows.weighs(c)) find_inverse_mass(rows, c, trees);
  c.can_be_loaded = input.gap < 0.0 || rows.inverse_mass[c.row] > 0.0 || c.ground >= 0;
}

}  // namespace

// Replaces the rows by those of constraints and contacts, in this order, and the materials by
// theirs, one per group; fills in the inverse inertia of the trees they reach.
void Stepper::Impl::build_rows(mjData_* d) {
  act_along_in_links(d);
  const Trees& trees = motion.trees();
  int count = static_cast<int>(constraints.size());
  for (const ContactInput& contact : contacts) count += contact.dim;
  rows.reset(count);
  rows.metre = host::metre(model);
  materials.resize(constraints.size() + contacts.size());
  for (size_t i = 0; i < constraints.size(); ++i) {
    const ConstraintInput& input = constraints[i];
    RowGroup& c = rows.append(input.kind, static_cast<int>(i), 1, input.tree);
    if (rows.weighs(c)) motion.ask_for_inverse(c.tree);
    rows.friction[c.row] = input.limit;
    c.is_damper = input.damping > 0.0;
    rows.typical_inverse_mass[c.row] = host::typical_inverse_mass(model, d, input);
    materials[i] = material_of(input);
    host::append_jacobian(model, d, input, trees, row_turns, rows);
    if (rows.weighs(c)) append_mass_weighted(rows, c, trees);
  }
  mark_ends_of_ranges(constraints, rows);
  append_contacts(model, d, contacts, motion, rows);
  motion.invert_inertia(d, team);
  const int groups = static_cast<int>(rows.group.size());
  team.share(groups, kGroupsAtOnce, [&](int, int first, int last) {
    for (int i = first; i < last; ++i) {
      if (i + static_cast<int>(kPrefetched) < last)
        prefetch_inertia(trees, rows.group[i + kPrefetched].tree);
      RowGroup& c = rows.group[i];
      if (c.kind == RowKind::kContact)
        fill_contact(model, d, parameters, contacts[c.input], trees, rows, c, materials[i]);
      else if (rows.weighs(c))
        find_inverse_mass(rows, c, trees);
    }
  });
}

}  // namespace dashpot
