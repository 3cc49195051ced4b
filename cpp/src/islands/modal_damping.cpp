#include "dashpot/islands/modal_damping.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/model/properties.hpp"

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

bool is_like(const GroupMaterial& a, const GroupMaterial& b) {
  return a.from_solref == b.from_solref && a.is_rigid() == b.is_rigid() &&
         has_ratio(a) == has_ratio(b);
}

// Whether two contacts are between the same two bodies, one of which may be static.
bool join_same_bodies(const mjModel_* model, const ContactInput& a, const ContactInput& b) {
  if (a.is_of_flex() || b.is_of_flex()) return a.geom == b.geom;
  for (int side = 0; side < 2; ++side)
    if (host::moved_body(model, a.geom[side]) != host::moved_body(model, b.geom[side]))
      return false;
  return true;
}

// Stiffness of a contact relative to others of its pair: rigid ones have k = kappa / w.
double relative_stiffness(const RowGroup& c, bool rigid) {
  return rigid ? 1.0 / c.pair_inverse_mass : 1.0;
}

// Of the normals of contacts between two bodies, without those that stay open, unless all do.
double mean_inverse_mass(const Rows& rows, size_t first, size_t last,
                         const std::vector<char>& stays_open) {
  double sum[2] = {};
  int count[2] = {};
  for (size_t i = first; i < last; ++i) {
    const int row = rows.group[i].row, open = stays_open[i] != 0;
    if (rows.inverse_mass[row] > 0.0) sum[open] += rows.bounded_inverse_mass(row);
    ++count[open];
  }
  const int of = count[0] == 0;
  return sum[of] / count[of];
}

void find_compressions(const Rows& rows, const std::vector<ContactInput>& contacts,
                       const GroupMaterial& given, size_t first, size_t last, const RowData& data,
                       double length, std::vector<double>& compression) {
  thread_local std::vector<double> approach;  // kept by the thread: no allocation in a step
  approach.clear();
  double onset = length, lasting = given.is_rigid() ? kRigidMicrostep : 0.0;
  for (size_t i = first; i < last; ++i) {
    const RowGroup& c = rows.group[i];
    approach.push_back(std::max(0.0, -first_rate(rows, c, data.velocity)));
    const double gap = contacts[c.input].gap;
    if (gap <= 0.0)
      onset = 0.0;
    else if (gap < onset * approach.back())
      onset = gap / approach.back();
    if (given.has_si_stiffness())
      lasting =
          std::max(lasting, 1.0 / std::sqrt(rows.inverse_mass[c.row] * given.material.stiffness));
  }
  const double time = onset + 0.5 * std::min(length - onset, lasting);
  for (size_t i = first; i < last; ++i)
    compression[i] = std::max(0.0, time * approach[i - first] - contacts[rows.group[i].input].gap);
}

double square_frequency(const Rows& rows, const Trees& trees, size_t first, size_t last, bool rigid,
                        const std::vector<double>& compression) {
  thread_local AlignedDoubles pushes, response;
  pushes.resize(trees.coordinates);
  response.resize(trees.coordinates);
  std::fill_n(pushes.begin(), kGroundCoordinates, 0.0);
  const auto& touched = rows.group[first].tree;
  for (int tree : touched)
    if (tree >= 0) {
      const Tree& t = trees.tree[tree];
      std::fill_n(pushes.begin() + t.begin, t.count, 0.0);
      std::fill_n(response.begin() + t.begin, t.count, 0.0);
    }
  double energy = 0.0, power = 0.0;
  for (size_t i = first; i < last; ++i) {
    const RowGroup& c = rows.group[i];
    const double force = relative_stiffness(c, rigid) * compression[i];
    scatter(rows, c, 1, &force, pushes.data());
    energy += force * compression[i];
  }
  for (int tree : touched)
    if (tree >= 0) {
      const Tree& t = trees.tree[tree];
      add_response(trees, tree, pushes.data() + t.begin, response.data() + t.begin);
      for (int i = t.begin; i < t.begin + t.count; ++i) power += pushes[i] * response[i];
    }
  return power / energy;
}

}  // namespace

void damp_modes(const mjModel_* model, const std::vector<GroupMaterial>& materials,
                const std::vector<ContactInput>& contacts, const Trees& trees,
                const std::vector<char>& stays_open, const RowData& data, double length, Rows& rows,
                std::vector<double>& compression) {
  const size_t count = rows.group.size();
  compression.assign(count, 1.0);
  const bool any_ties = count > 0 && rows.group[0].kind != RowKind::kContact;
  for (size_t first = 0, last; first < count; first = last) {
    last = first + 1;
    if (rows.group[first].kind != RowKind::kContact || materials[first].from_solref) continue;
    const ContactInput& contact = contacts[rows.group[first].input];
    while (last < count && is_like(materials[first], materials[last]) &&
           join_same_bodies(model, contact, contacts[rows.group[last].input]))
      ++last;
    const auto begin = rows.group.begin() + first, end = rows.group.begin() + last;
    const double mean = mean_inverse_mass(rows, first, last, stays_open);
    for (auto c = begin; c != end; ++c) {
      c->first_of_pair = static_cast<int>(first);
      // Parts of a flex are bodies of their own.
      c->pair_inverse_mass = contact.is_of_flex() ? rows.bounded_inverse_mass(c->row) : mean;
    }
    if (last == first + 1 || !(has_ratio(materials[first]) || any_ties)) continue;
    if (std::any_of(begin, end, [&](const RowGroup& c) { return rows.inverse_mass[c.row] == 0.0; }))
      continue;
    find_compressions(rows, contacts, materials[first], first, last, data, length, compression);
    const bool pressed = std::any_of(compression.begin() + first, compression.begin() + last,
                                     [](double x) { return x > 0.0; });
    if (!pressed || !has_ratio(materials[first])) continue;
    const bool rigid = materials[first].is_rigid();
    const double square = square_frequency(rows, trees, first, last, rigid, compression);
    for (auto c = begin; c != end; ++c)
      c->pressed =
          std::max(kLeastPressed, square / (c->pair_inverse_mass * relative_stiffness(*c, rigid)));
  }
}

}  // namespace dashpot
