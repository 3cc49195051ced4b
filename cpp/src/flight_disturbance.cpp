#include "dashpot/flight_disturbance.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_properties.hpp"
#include "dashpot/mujoco_trees.hpp"

namespace dashpot {

void FlightDisturbance::reset(const mjModel_* model, const Memory& memory, double length) {
  length_ = length;
  const int trees = host::tree_count(model);
  disturbed_.assign(trees, 0);
  shaken_.assign(trees, 0);
  departure_.assign(trees, 0.0);
  release_.clear();
  joined_.clear();
  for (int i = 0; i < memory.contact_count(); ++i) {
    const RememberedContact contact = memory.contact(i);
    const std::array<int, 2> geom = {int(contact.geom[0]), int(contact.geom[1])};
    double inverse_mass = 0.0;
    for (int g : geom)
      if (g >= 0) inverse_mass += host::geom_inverse_mass(model, g);
    const double rate = std::sqrt(contact.stiffness * inverse_mass);
    release_.push_back({geom, contact.compression * rate * std::min(1.0, rate * length)});
  }
}

void FlightDisturbance::add(const ContactInput& contact, const std::array<double, 2>& rates,
                            double most) {
  mark(contact.tree, disturbed_);
  joined_.push_back(contact.tree);
  const double closing = std::max(0.0, -rates[0]), added = std::max(0.0, rates[0] - rates[1]);
  const double departure =
      2.0 * length_ * (2.0 * closing + 0.5 * added + release_speed(contact.geom));
  if (departure > most) mark(contact.tree, shaken_);
  for (int tree : contact.tree)
    if (tree >= 0) departure_[tree] += departure;
}

void FlightDisturbance::shake(const std::array<int, 2>& trees) {
  mark(trees, disturbed_);
  mark(trees, shaken_);
}

void FlightDisturbance::hand_on() {
  for (bool changed = true; changed;) {
    changed = false;
    for (const std::array<int, 2>& trees : joined_)
      if (any(shaken_, trees)) changed = mark(trees, shaken_) || changed;
  }
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

double FlightDisturbance::release_speed(const std::array<int, 2>& geom) const {
  double squared = 0.0;
  for (const Release& release : release_)
    if (release.geom == geom) squared += release.speed * release.speed;
  return std::sqrt(squared);
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
