#include "dashpot/impacts/flight_disturbance.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco/properties.hpp"
#include "dashpot/mujoco/trees.hpp"

namespace dashpot {

void FlightDisturbance::reset(const mjModel_* model, double length) {
  model_ = model;
  length_ = length;
  const int trees = host::tree_count(model);
  for (std::vector<char>* marked : {&disturbed_, &shaken_, &looked_at_}) marked->assign(trees, 0);
  departure_.assign(trees, 0.0);
}

bool FlightDisturbance::may_be_held(const ContactInput& contact) const {
  const bool one_is_fixed = (contact.tree[0] < 0) != (contact.tree[1] < 0);
  return one_is_fixed && !contact.is_of_flex() && any(looked_at_, contact.tree);
}

void FlightDisturbance::hold(const Memory& memory, const ContactInput& contact,
                             const std::array<double, 2>& rates, double most) {
  mark(contact.tree, disturbed_);
  const double closing = std::max(0.0, -rates[0]), added = std::max(0.0, rates[0] - rates[1]);
  const double departure =
      2.0 * length_ * (2.0 * closing + 0.5 * added + release_speed(memory, contact.geom));
  if (departure > most) mark(contact.tree, shaken_);
  for (int tree : contact.tree)
    if (tree >= 0) departure_[tree] += departure;
}

void FlightDisturbance::shake(const std::array<int, 2>& trees) {
  mark(trees, disturbed_);
  mark(trees, shaken_);
}

void FlightDisturbance::spread(const std::vector<ContactInput>& contacts) {
  for (std::vector<char>* marked : {&disturbed_, &shaken_})
    for (bool changed = true; changed;) {
      changed = false;
      for (const ContactInput& contact : contacts)
        if (any(*marked, contact.tree)) changed = mark(contact.tree, *marked) || changed;
    }
}

double FlightDisturbance::departure(const std::array<int, 2>& trees) const {
  double sum = 0.0;
  for (int tree : trees)
    if (tree >= 0) sum += departure_[tree];
  return sum;
}

double FlightDisturbance::release_speed(const Memory& memory,
                                        const std::array<int, 2>& geom) const {
  const double inverse_mass =
      host::geom_inverse_mass(model_, geom[0]) + host::geom_inverse_mass(model_, geom[1]);
  double squared = 0.0;
  for (int i = 0; i < memory.contact_count(); ++i) {
    const RememberedContact contact = memory.contact(i);
    if (contact.geom[0] != geom[0] || contact.geom[1] != geom[1]) continue;
    const double rate = std::sqrt(contact.stiffness * inverse_mass);
    const double speed = contact.compression * rate * std::min(1.0, rate * length_);
    squared += speed * speed;
  }
  return std::sqrt(squared);
}

bool FlightDisturbance::are_shaken(const std::array<int, 2>& trees) const {
  return std::all_of(trees.begin(), trees.end(),
                     [&](int tree) { return tree < 0 || shaken_[tree]; });
}

bool FlightDisturbance::any(const std::vector<char>& marked, const std::array<int, 2>& trees) {
  return std::any_of(trees.begin(), trees.end(),
                     [&](int tree) { return tree >= 0 && marked[tree]; });
}

bool FlightDisturbance::mark(const std::array<int, 2>& trees, std::vector<char>& marked) {
  bool changed = false;
  for (int tree : trees) {
    changed = changed || (tree >= 0 && !marked[tree]);
    if (tree >= 0) marked[tree] = 1;
  }
  return changed;
}

}  // namespace dashpot
