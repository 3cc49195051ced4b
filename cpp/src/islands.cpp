#include "dashpot/islands.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace dashpot {

namespace {

constexpr double kRigidMaxRatio = 3;  // damping ratio standing for restitution 0 (e < 0.03)
constexpr double kMaxRatio = 50;      // the same for SI stiffness (e < 1e-4)
constexpr double kRounding = 1e-12;   // relative, of quotients and roots

// Inverse mass that rigid rows divide by. A contact row without any cannot be loaded; an
// equality may pass a singular configuration.
double loaded_inverse_mass(const Rows& rows, const RowGroup& c, int row) {
  const bool immobile = c.kind == RowKind::kContact && rows.inverse_mass[row] == 0.0;
  return immobile ? 0.0 : rows.bounded_inverse_mass(row);
}

// Inverse mass that the stiffness of friction row i divides by: of the two sliding or the two
// rolling rows the larger, so that springs are isotropic whatever the tangents are.
template <typename InverseMass>
double isotropic_inverse_mass(const RowGroup& c, int i, InverseMass inverse_mass) {
  if (i == 3) return inverse_mass(c.row + 3);
  const int first = c.row + (i < 3 ? 1 : 4);
  return std::max(inverse_mass(first), inverse_mass(first + 1));
}

// Stiffness and damping of a group's rows of a material in SI units, before clipping. Rotational
// rows get the stiffness that gives them the natural frequency of the sliding rows.
void fill_given_rows(Rows& rows, const RowGroup& c, const Material& material) {
  const int n = c.row;
  const double w_normal = rows.inverse_mass[n];
  rows.stiffness[n] = material.stiffness;
  const double damping = w_normal > 0.0 ? damping_of(material, material.stiffness, w_normal) : 0.0;
  rows.damping[n] =
      std::isfinite(damping) ? damping : 2.0 * kMaxRatio * std::sqrt(material.stiffness / w_normal);
  if (c.dim == 1) return;
  const double tangential = material.tangential_ratio * rows.stiffness[n];
  const auto inverse_mass = [&](int row) { return rows.inverse_mass[row]; };
  const double sliding_inverse_mass = isotropic_inverse_mass(c, 1, inverse_mass);
  for (int i = 1; i < c.dim; ++i) {
    const double w = rows.inverse_mass[n + i];
    const double largest = isotropic_inverse_mass(c, i, inverse_mass);
    const double k =
        i < 3 || largest == 0.0 ? tangential : tangential * sliding_inverse_mass / largest;
    rows.stiffness[n + i] = k;
    rows.damping[n + i] =
        w == 0.0 ? 0.0 : 2.0 * material.tangential_damping_ratio * std::sqrt(k / w);
  }
}

// kappa h^2 of rigid rows whose bound is c, see below.
double stiffest_rigid(double bound) {
  const double coupling = std::max(0.0, bound - 1.0);
  return std::min(1.0, coupling > 0.0 ? kRigidResolution * kRigidResolution / coupling : 1.0);
}

// What is asked of a row: kappa (1/s^2) and delta (1/s).
struct Rates {
  double stiffness = 0.0, damping = 0.0;
};

// Of a group's first row: by its own solref, or by a material in SI units.
Rates given_rates(const Rows& rows, const RowGroup& c, const GroupMaterial& given) {
  const double w = loaded_inverse_mass(rows, c, c.row);
  if (!given.from_solref) return {rows.stiffness[c.row] * w, rows.damping[c.row] * w};
  const double typical = rows.typical_inverse_mass[c.row];
  const double ratio = typical > 0.0 ? w / typical : 1.0;
  return {given.normalised_stiffness * ratio, given.normalised_damping * std::sqrt(ratio)};
}

// Whether stiffness gives way to a group's restitution.
bool keeps_restitution(const GroupMaterial& given) {
  return !given.from_solref && given.material.rigid &&
         given.material.form == DampingForm::kRestitution;
}

// The damping ratio of a rigid material's contact alone.
double damping_ratio(const Material& material) {
  if (material.form != DampingForm::kRestitution) return material.damping;
  return std::min(restitution_to_damping_ratio(material.damping), kRigidMaxRatio);
}

// Of a contact between two trees with the parts w_1 and w_2 of its inverse mass, the weight of the
// heavier accelerates the lighter by a = g max(w_1, w_2) / min(w_1, w_2). `sag_time` is that of g;
// the result is that of a.
double loaded_sag_time(const Rows& rows, const RowGroup& c, double sag_time) {
  const auto [heavy, light] =
      std::minmax(rows.tree_inverse_mass[c.row][0], rows.tree_inverse_mass[c.row][1]);
  return heavy > 0.0 ? sag_time * std::sqrt(heavy / light) : sag_time;
}

// delta of rigid rows whose coupled damping has the bound c, times h, see below.
double most_damped_rigid(double bound) {
  return bound > 1.0 ? kRigidResolution / (bound - 1.0) : std::numeric_limits<double>::infinity();
}

// Whether a value is within a bound, but for the last bits.
bool fits(double value, double bound) { return value <= bound * (1.0 + kRounding); }

// Rigid rows: k = kappa / w, d = delta / w. With c the bound of the unit-weighted rows, diag(A) = 1
// in these units, the flow of every row on its own is exact and only the coupling c - 1 has to be
// resolved:
//     kappa (c - 1) h^2 <= theta^2,   kappa h^2 <= 1,
//     delta_n (c_n - 1) h <= theta,   delta_t (c_t - 1) h <= theta
// with c_n and c_t for the damping of normals and friction (RigidCoupling). A damping ratio is that
// of the contact alone, delta = 2 zeta sqrt(kappa), as far as the bounds allow; for a restitution
// kappa gives way as far as a weight sags no further than kInelasticSag. A model's own solref is a
// kappa and a delta, as far as the bounds allow. A material in SI units that micro-steps do not
// resolve is rigid, no stiffer than it says, and has its damping ratio as far as the bounds allow.
// Returns whether nothing that was given was lowered.
bool fill_rigid_rows(Rows& rows, const RowGroup& c, const GroupMaterial& given,
                     const RigidCoupling& coupling, double sag_time, double h) {
  const Material& material = given.material;
  const bool is_limited = !given.rigid() || given.from_solref;
  const Rates asked = is_limited ? given_rates(rows, c, given) : Rates();
  const double resolved = stiffest_rigid(coupling.stiffness) / (h * h);
  const double stiffest = is_limited ? std::min(resolved, asked.stiffness) : resolved;
  const double most_damped = most_damped_rigid(coupling.normal_damping) / h;
  // By the bound on w: k = kappa / w would turn the frozen geometry's error near a singular
  // configuration into arbitrary forces.
  const auto fill = [&](int row, double kappa, double delta) {
    const double w = loaded_inverse_mass(rows, c, row);
    const double mass = w > 0.0 ? 1.0 / w : 0.0;
    // Where nothing moves along a row, any positive stiffness carries its zero load.
    rows.stiffness[row] = w > 0.0 ? kappa * mass : 1.0;
    rows.damping[row] = w > 0.0 ? delta * mass : 0.0;
  };
  double kappa = stiffest, delta = asked.damping;
  bool as_given = fits(asked.stiffness, resolved);
  if (!given.rigid() && asked.stiffness > 0.0) delta *= std::sqrt(kappa / asked.stiffness);
  if (!is_limited) {
    const double zeta = damping_ratio(material);
    if (keeps_restitution(given) && zeta > 0.0) {
      const double bearing =
          kRigidSag / kInelasticSag / std::pow(loaded_sag_time(rows, c, sag_time), 2);
      kappa = std::min(kappa, std::max(std::pow(most_damped / (2.0 * zeta), 2), bearing));
    }
    delta = 2.0 * zeta * std::sqrt(kappa);
  }
  if (is_limited || keeps_restitution(given)) as_given = as_given && fits(delta, most_damped);
  fill(c.row, kappa, std::min(delta, most_damped));
  const double most_damped_sliding = most_damped_rigid(coupling.friction_damping) / h;
  const auto inverse_mass = [&](int row) { return loaded_inverse_mass(rows, c, row); };
  const double stiffest_sliding = given.rigid() ? stiffest : resolved;
  for (int i = 1; i < c.dim; ++i) {
    const int row = c.row + i;
    const double w = inverse_mass(row);
    double sliding = stiffest_sliding;
    if (w > 0.0) sliding *= w / isotropic_inverse_mass(c, i, inverse_mass);
    if (!given.rigid()) {
      as_given = as_given && fits(rows.stiffness[row] * w, sliding);
      sliding = std::min(sliding, rows.stiffness[row] * w);
    }
    const double sliding_damping = 2.0 * material.tangential_damping_ratio * std::sqrt(sliding);
    if (!given.rigid()) as_given = as_given && fits(sliding_damping, most_damped_sliding);
    fill(row, sliding, std::min(sliding_damping, most_damped_sliding));
  }
  return as_given;
}

// Longest micro-step that resolves the rates of a model's own solref under a bound.
double longest_solref_microstep(const Rates& asked, const RigidCoupling& coupling) {
  double h = std::numeric_limits<double>::infinity();
  if (asked.stiffness > 0.0) h = std::sqrt(stiffest_rigid(coupling.stiffness) / asked.stiffness);
  if (asked.damping > 0.0)
    h = std::min(h, most_damped_rigid(coupling.normal_damping) / asked.damping);
  return h;
}

// Longest micro-step in which a rigid material's restitution leaves the stiffness that weights
// need.
double longest_inelastic_microstep(const Material& material, const RigidCoupling& coupling,
                                   double sag_time) {
  const double zeta = damping_ratio(material);
  if (zeta == 0.0) return std::numeric_limits<double>::infinity();
  return most_damped_rigid(coupling.normal_damping) * sag_time *
         std::sqrt(kInelasticSag / kRigidSag) / (2.0 * zeta);
}

}  // namespace

const std::vector<Island>& Islands::find(const Rows& rows, const Trees& trees) {
  const int tree_count = static_cast<int>(trees.tree.size());
  root_.resize(tree_count);
  std::iota(root_.begin(), root_.end(), 0);
  const auto find_root = [&](int tree) {
    while (root_[tree] != tree) tree = root_[tree] = root_[root_[tree]];
    return tree;
  };
  const auto tree_of = [](const RowGroup& c) { return c.tree[0] >= 0 ? c.tree[0] : c.tree[1]; };
  for (const RowGroup& c : rows.group)
    if (c.tree[0] >= 0 && c.tree[1] >= 0) {
      const int a = find_root(c.tree[0]), b = find_root(c.tree[1]);
      root_[std::max(a, b)] = std::min(a, b);
    }
  // Number islands by their first group, then count and sort groups and trees into them.
  island_of_.assign(tree_count, -1);
  int count = 0;
  for (const RowGroup& c : rows.group) {
    int& island = island_of_[find_root(tree_of(c))];
    if (island < 0) island = count++;
  }
  islands_.assign(count, Island{});
  const auto sort_into = [&](std::vector<int>& order, int members, const auto& island_of_member,
                             Indices Island::*range) {
    first_.assign(count + 1, 0);
    for (int i = 0; i < members; ++i)
      if (const int island = island_of_member(i); island >= 0) ++first_[island + 1];
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    order.resize(first_.back());
    for (int island = 0; island < count; ++island)
      (islands_[island].*range).first = (islands_[island].*range).last =
          order.data() + first_[island];
    for (int i = 0; i < members; ++i)
      if (const int island = island_of_member(i); island >= 0)
        order[(islands_[island].*range).last++ - order.data()] = i;
  };
  sort_into(
      group_order_, static_cast<int>(rows.group.size()),
      [&](int i) { return island_of_[find_root(tree_of(rows.group[i]))]; }, &Island::group);
  sort_into(
      tree_order_, tree_count, [&](int i) { return island_of_[find_root(i)]; }, &Island::tree);
  return islands_;
}

void Islands::plan(Rows& rows, const Trees& trees, const std::vector<GroupMaterial>& materials,
                   const std::vector<double>& sag_time, double step, const Options& options) {
  bounds_.assign(trees.tree.size(), TreeBounds{});
  has_friction_.assign(trees.tree.size(), 0);
  for (CoupledSum* sum : {&stiffness_, &damping_, &rigid_, &rigid_normal_}) sum->reset(trees);
  for (Island& island : islands_) {
    for (int index : island.group)
      if (!materials[index].rigid())
        fill_given_rows(rows, rows.group[index], materials[index].material);
    measure(island, rows, trees, materials, false);
    const double si_microstep = longest_si_microstep(island);
    double count = options.microsteps;
    if (options.microsteps == 0) {
      const double longest =
          std::min(si_microstep, longest_rigid_microstep(island, rows, materials, sag_time));
      count = std::max<double>(kMinimumMicrosteps, step / longest);
    }
    // Rounding up must not add a micro-step for the last bit of a quotient.
    island.microsteps = static_cast<int>(
        std::ceil(std::min<double>(count, options.max_microsteps) * (1.0 - kRounding)));
    island.duration = step / island.microsteps;
    const bool resolves_si = fits(island.duration, si_microstep);
    if (!resolves_si) measure(island, rows, trees, materials, true);
    for (int index : island.group) {
      const RowGroup& c = rows.group[index];
      if (resolves_si && !materials[index].rigid()) continue;
      if (!fill_rigid_rows(rows, c, materials[index], rigid_coupling(c), sag_time[index],
                           island.duration))
        island.clipped += c.dim;
    }
  }
}

void Islands::measure(const Island& island, const Rows& rows, const Trees& trees,
                      const std::vector<GroupMaterial>& materials, bool all_rigid) {
  for (int index : island.group)
    if (const RowGroup& c = rows.group[index]; c.dim > 1)
      for (int tree : c.tree)
        if (tree >= 0) has_friction_[tree] = 1;
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const bool is_rigid = all_rigid || materials[index].rigid();
    // The weight of a row in a tree, k (1 + sqrt(w_other / w)), without k.
    double split[2][kMaxRows];
    for (int i = 0; i < c.dim; ++i) {
      const auto [w0, w1] = rows.tree_inverse_mass[c.row + i];
      const double both = std::sqrt(w0 * w1);
      split[0][i] = w0 > 0.0 ? (w0 + both) / w0 : 0.0;
      split[1][i] = w1 > 0.0 ? (w1 + both) / w1 : 0.0;
    }
    double weight[kMaxRows];
    const auto add = [&](CoupledSum& sum, int side, const auto& weight_of_row) {
      for (int i = 0; i < c.dim; ++i) weight[i] = split[side][i] * weight_of_row(c.row + i);
      sum.add(rows, trees, c, side, c.dim, weight);
    };
    for (int side = 0; side < 2; ++side) {
      if (c.tree[side] < 0) continue;
      if (is_rigid) {
        add(rigid_, side, [&](int row) {
          return rows.inverse_mass[row] > 0.0 ? 1.0 / rows.inverse_mass[row] : 0.0;
        });
        if (has_friction_[c.tree[side]]) rigid_normal_.add(rows, trees, c, side, 1, weight);
      } else {
        add(stiffness_, side, [&](int row) { return rows.stiffness[row]; });
        add(damping_, side, [&](int row) { return rows.damping[row]; });
      }
    }
  }
  for (int tree : island.tree)
    bounds_[tree] = {stiffness_.take_bound(trees, tree), damping_.take_bound(trees, tree),
                     rigid_.take_bound(trees, tree), rigid_normal_.take_bound(trees, tree)};
}

// Longest micro-step that resolves every SI value.
double Islands::longest_si_microstep(const Island& island) const {
  double h = std::numeric_limits<double>::infinity();
  for (int tree : island.tree) {
    const TreeBounds& b = bounds_[tree];
    if (b.stiffness > 0.0) h = std::min(h, kResolution * std::sqrt(b.si_share() / b.stiffness));
    if (b.damping > 0.0) h = std::min(h, kResolution * b.si_share() / b.damping);
  }
  return h;
}

// Longest micro-step at which rigid contacts are stiff enough for a heavy body on a light one,
//     h^2 <= kappa h^2 sag / a ,
// and as damped as their restitution says at that stiffness. Rows of a model's own solref need not
// be stiffer than it says.
double Islands::longest_rigid_microstep(const Island& island, const Rows& rows,
                                        const std::vector<GroupMaterial>& materials,
                                        const std::vector<double>& sag_time) const {
  double h = std::numeric_limits<double>::infinity();
  for (int index : island.group) {
    const GroupMaterial& given = materials[index];
    if (!given.rigid()) continue;
    const RowGroup& c = rows.group[index];
    double longest = kRigidMicrostep;
    const RigidCoupling coupling = rigid_coupling(c);
    const double sag = loaded_sag_time(rows, c, sag_time[index]);
    if (c.tree[0] >= 0 && c.tree[1] >= 0)
      longest = std::min(longest, sag * std::sqrt(stiffest_rigid(coupling.stiffness)));
    if (keeps_restitution(given))
      longest = std::min(longest, longest_inelastic_microstep(given.material, coupling, sag));
    if (given.from_solref)
      longest = std::max(longest, longest_solref_microstep(given_rates(rows, c, given), coupling));
    h = std::min(h, longest);
  }
  return h;
}

RigidCoupling Islands::rigid_coupling(const RowGroup& c) const {
  RigidCoupling most;
  for (int tree : c.tree) {
    if (tree < 0) continue;
    const RigidCoupling own = bounds_[tree].rigid_coupling();
    most.stiffness = std::max(most.stiffness, own.stiffness);
    most.normal_damping = std::max(most.normal_damping, own.normal_damping);
    most.friction_damping = std::max(most.friction_damping, own.friction_damping);
  }
  return most;
}

// (a + b)^2 <= (1 + s) a^2 + (1 + 1/s) b^2 splits the bound between normals and friction, where
// that is the better one for normals: s is what critical damping of the stiffest normals leaves to
// friction, 2 sqrt(kappa) h ((1 + s) c_n - 1) = theta, at least kFrictionShare.
RigidCoupling Islands::TreeBounds::rigid_coupling() const {
  const double all = rigid / rigid_share(), normal = rigid_normal / rigid_share();
  if (normal == 0.0) return {all, all, all};
  const double resolved = 1.0 + kRigidResolution / (2.0 * std::sqrt(stiffest_rigid(all)));
  const double share = std::max(kFrictionShare, resolved / normal - 1.0);
  if ((1.0 + share) * normal >= all) return {all, all, all};
  return {all, (1.0 + share) * normal, (1.0 + 1.0 / share) * all};
}

}  // namespace dashpot
