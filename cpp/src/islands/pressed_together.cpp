#include "dashpot/islands/pressed_together.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands/row_stiffness.hpp"

namespace dashpot {

namespace {

// Pushes of opposite normals cancel, and damping in proportion to 1 / omega would grow without
// bound: least square frequency, relative to that of a contact alone.
constexpr double kLeastPressed = 0.1;

bool has_ratio(const GroupMaterial& given) {
  if (given.from_solref) return false;
  return given.is_rigid() ? given.material.form == DampingForm::kRestitution
                          : given.material.form != DampingForm::kDamping;
}

// Stiffness of a contact relative to others of its pair: rigid ones have k = kappa / w.
double relative_stiffness(const Rows& rows, const RowGroup& c, bool rigid) {
  return rigid ? 1.0 / rows.inverse_mass[c.row] : 1.0;
}

}  // namespace

void PressedTogether::find(const std::vector<GroupMaterial>& materials,
                           const std::vector<ContactInput>& contacts, const Trees& trees,
                           const RowData& data, double length, Rows& rows) {
  const size_t count = rows.group.size();
  for (size_t first = 0, last; first < count; first = last) {
    last = first + 1;
    if (rows.group[first].kind != RowKind::kContact || !has_ratio(materials[first])) continue;
    const auto& geom = contacts[rows.group[first].input].geom;
    while (last < count && contacts[rows.group[last].input].is_of_pair(geom)) ++last;
    if (last == first + 1) continue;
    const auto begin = rows.group.begin() + first, end = rows.group.begin() + last;
    if (std::any_of(begin, end, [&](const RowGroup& c) { return rows.inverse_mass[c.row] == 0.0; }))
      continue;
    find_compressions(rows, contacts, materials[first], first, last, data, length);
    if (*std::max_element(compression_.begin(), compression_.end()) == 0.0) continue;
    const bool rigid = materials[first].is_rigid();
    const double square = square_frequency(rows, trees, first, rigid);
    for (auto c = begin; c != end; ++c)
      c->pressed = std::max(kLeastPressed, square / (rows.inverse_mass[c->row] *
                                                     relative_stiffness(rows, *c, rigid)));
  }
}

void PressedTogether::find_compressions(const Rows& rows, const std::vector<ContactInput>& contacts,
                                        const GroupMaterial& given, size_t first, size_t last,
                                        const RowData& data, double length) {
  approach_.clear();
  compression_.clear();
  double onset = length, lasting = given.is_rigid() ? kRigidMicrostep : 0.0;
  for (size_t i = first; i < last; ++i) {
    const RowGroup& c = rows.group[i];
    double rate;
    gather(rows, c.normal(), data.velocity.data(), &rate);
    approach_.push_back(std::max(0.0, -rate));
    const double gap = contacts[c.input].gap;
    if (gap <= 0.0)
      onset = 0.0;
    else if (gap < onset * approach_.back())
      onset = gap / approach_.back();
    if (given.has_si_stiffness())
      lasting =
          std::max(lasting, 1.0 / std::sqrt(rows.inverse_mass[c.row] * given.material.stiffness));
  }
  const double time = onset + 0.5 * std::min(length - onset, lasting);
  for (size_t i = first; i < last; ++i)
    compression_.push_back(
        std::max(0.0, time * approach_[i - first] - contacts[rows.group[i].input].gap));
}

// Of the contacts from `first` on, at unit relative stiffness.
double PressedTogether::square_frequency(const Rows& rows, const Trees& trees, size_t first,
                                         bool rigid) {
  force_.resize(trees.coordinates);
  response_.resize(trees.coordinates);
  std::fill_n(force_.begin(), kGroundCoordinates, 0.0);
  const auto& touched = rows.group[first].tree;
  for (int tree : touched)
    if (tree >= 0) {
      const Tree& t = trees.tree[tree];
      std::fill_n(force_.begin() + t.begin, t.count, 0.0);
      std::fill_n(response_.begin() + t.begin, t.count, 0.0);
    }
  double energy = 0.0, power = 0.0;
  for (size_t i = 0; i < compression_.size(); ++i) {
    const RowGroup& c = rows.group[first + i];
    const double k = relative_stiffness(rows, c, rigid);
    const double force = k * compression_[i];
    scatter(rows, c.normal(), &force, force_.data());
    energy += k * compression_[i] * compression_[i];
  }
  for (int tree : touched)
    if (tree >= 0) {
      const Tree& t = trees.tree[tree];
      add_response(trees, tree, force_.data() + t.begin, response_.data() + t.begin);
      for (int i = t.begin; i < t.begin + t.count; ++i) power += force_[i] * response_[i];
    }
  return power / energy;
}

}  // namespace dashpot
