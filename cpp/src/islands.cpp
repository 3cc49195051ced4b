#include "dashpot/islands.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace dashpot {

namespace {

constexpr double kRigidMaxRatio = 5;  // damping ratio standing for restitution 0 (e < 0.01)
constexpr double kMaxRatio = 50;      // the same for SI stiffness (e < 1e-4)

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

// What a group's own solref asks of its first row: kappa (1/s^2) and delta (1/s).
struct SolrefRate {
  double stiffness = 0.0, damping = 0.0;
};

SolrefRate solref_rate(const Rows& rows, const RowGroup& c, const GroupMaterial& given) {
  const double w = loaded_inverse_mass(rows, c, c.row);
  const double typical = rows.typical_inverse_mass[c.row];
  const double ratio = typical > 0.0 ? w / typical : 1.0;
  return {given.normalised_stiffness * ratio, given.normalised_damping * std::sqrt(ratio)};
}

// Rigid rows: k = kappa / w, d = delta / w. With c the bound of the unit-weighted rows, diag(A) = 1
// in these units, the flow of every row on its own is exact and only the coupling c - 1 has to be
// resolved:
//     kappa (c - 1) h^2 <= theta^2,   delta (c - 1) h <= theta,   kappa h^2 <= 1 .
// A damping ratio is that of the stiffest coupled mode, delta = 2 zeta sqrt(kappa / c), as far as
// the second bound allows; a restitution is that of the contact alone, delta = 2 zeta sqrt(kappa),
// for which kappa gives way. A model's own solref is a kappa and a delta of the contact alone, as
// far as the bounds allow. Returns whether they do.
bool fill_rigid_rows(Rows& rows, const RowGroup& c, const GroupMaterial& given, double bound,
                     double h) {
  const Material& material = given.material;
  const SolrefRate own = solref_rate(rows, c, given);
  const double coupling = std::max(0.0, bound - 1.0);
  const double resolved = stiffest_rigid(bound) / (h * h);
  const double stiffest = given.from_solref ? std::min(resolved, own.stiffness) : resolved;
  const double most_damped =
      coupling > 0.0 ? kRigidResolution / (h * coupling) : std::numeric_limits<double>::infinity();
  // By the bound on w: k = kappa / w would turn the frozen geometry's error near a singular
  // configuration into arbitrary forces.
  const auto fill = [&](int row, double kappa, double delta) {
    const double w = loaded_inverse_mass(rows, c, row);
    const double mass = w > 0.0 ? 1.0 / w : 0.0;
    // Where nothing moves along a row, any positive stiffness carries its zero load.
    rows.stiffness[row] = w > 0.0 ? kappa * mass : 1.0;
    rows.damping[row] = w > 0.0 ? delta * mass : 0.0;
  };
  const double inverse_bound = 1.0 / bound;
  const auto fill_coupled = [&](int row, double zeta, double kappa) {
    fill(row, kappa, std::min(2.0 * zeta * std::sqrt(kappa * inverse_bound), most_damped));
  };
  if (given.from_solref) {
    fill(c.row, stiffest, std::min(own.damping, most_damped));
  } else if (material.form == DampingForm::kRestitution) {
    const double zeta = std::min(restitution_to_damping_ratio(material.damping), kRigidMaxRatio);
    const double kappa =
        zeta > 0.0 ? std::min(stiffest, std::pow(most_damped / (2.0 * zeta), 2)) : stiffest;
    fill(c.row, kappa, 2.0 * zeta * std::sqrt(kappa));
  } else {
    fill_coupled(c.row, material.damping, stiffest);
  }
  const auto inverse_mass = [&](int row) { return loaded_inverse_mass(rows, c, row); };
  for (int i = 1; i < c.dim; ++i) {
    const double w = inverse_mass(c.row + i);
    const double kappa =
        w > 0.0 ? stiffest * w / isotropic_inverse_mass(c, i, inverse_mass) : stiffest;
    fill_coupled(c.row + i, material.tangential_damping_ratio, kappa);
  }
  return !given.from_solref || (own.stiffness <= resolved && own.damping <= most_damped);
}

// Longest micro-step that resolves them under a bound.
double longest_solref_microstep(const SolrefRate& own, double bound) {
  const double coupling = std::max(0.0, bound - 1.0);
  double h = std::numeric_limits<double>::infinity();
  if (own.stiffness > 0.0) h = std::sqrt(stiffest_rigid(bound) / own.stiffness);
  if (own.damping * coupling > 0.0) h = std::min(h, kRigidResolution / (own.damping * coupling));
  return h;
}

double limit(double allowed, double bound) { return bound > allowed ? allowed / bound : 1.0; }

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
  for (CoupledSum* sum : {&stiffness_, &damping_, &rigid_}) sum->reset(trees);
  for (Island& island : islands_) {
    for (int index : island.group)
      if (!materials[index].rigid())
        fill_given_rows(rows, rows.group[index], materials[index].material);
    measure(island, rows, trees, materials);
    double count = options.microsteps;
    if (options.microsteps == 0) {
      const double longest = std::min(longest_si_microstep(island),
                                      longest_rigid_microstep(island, rows, materials, sag_time));
      count = std::max<double>(kMinimumMicrosteps, step / longest);
    }
    // Rounding up must not add a micro-step for the last bit of a quotient.
    island.microsteps = static_cast<int>(
        std::ceil(std::min<double>(count, options.max_microsteps) * (1.0 - 1e-12)));
    island.duration = step / island.microsteps;
    island.clipped = fill(island, rows, materials, island.duration);
  }
}

void Islands::measure(const Island& island, const Rows& rows, const Trees& trees,
                      const std::vector<GroupMaterial>& materials) {
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const bool is_rigid = materials[index].rigid();
    // The weight of a row in a tree, k (1 + sqrt(w_other / w)), without k.
    double split[2][kMaxRows];
    for (int i = 0; i < c.dim; ++i) {
      const auto [w0, w1] = rows.tree_inverse_mass[c.row + i];
      const double both = std::sqrt(w0 * w1);
      split[0][i] = w0 > 0.0 ? (w0 + both) / w0 : 0.0;
      split[1][i] = w1 > 0.0 ? (w1 + both) / w1 : 0.0;
    }
    const auto add = [&](CoupledSum& sum, const auto& weight_of_row) {
      double k[kMaxRows], weight[kMaxRows];
      for (int i = 0; i < c.dim; ++i) k[i] = weight_of_row(c.row + i);
      for (int side = 0; side < 2; ++side) {
        if (c.tree[side] < 0) continue;
        for (int i = 0; i < c.dim; ++i) weight[i] = split[side][i] * k[i];
        sum.add(rows, trees, c, side, weight);
      }
    };
    if (is_rigid) {
      add(rigid_, [&](int row) {
        return rows.inverse_mass[row] > 0.0 ? 1.0 / rows.inverse_mass[row] : 0.0;
      });
    } else {
      add(stiffness_, [&](int row) { return rows.stiffness[row]; });
      add(damping_, [&](int row) { return rows.damping[row]; });
    }
  }
  for (int tree : island.tree)
    bounds_[tree] = {stiffness_.take_bound(trees, tree), damping_.take_bound(trees, tree),
                     rigid_.take_bound(trees, tree)};
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

// Longest micro-step at which rigid contacts are stiff enough for a heavy body on a light one. Of a
// contact between two trees with the parts w_1 and w_2 of its inverse mass, the weight of the
// heavier accelerates the lighter by a = g max(w_1, w_2) / min(w_1, w_2) and sags by a / kappa:
//     h^2 <= kappa h^2 sag / a .
// Rows of a model's own solref need not be stiffer than it says.
double Islands::longest_rigid_microstep(const Island& island, const Rows& rows,
                                        const std::vector<GroupMaterial>& materials,
                                        const std::vector<double>& sag_time) const {
  double h = std::numeric_limits<double>::infinity();
  for (int index : island.group) {
    if (!materials[index].rigid()) continue;
    const RowGroup& c = rows.group[index];
    double longest = kRigidMicrostep;
    const auto [light, heavy] = std::minmax(rows.tree_inverse_mass[c.row][0],
                                            rows.tree_inverse_mass[c.row][1], std::greater<>());
    const double bound = rigid_coupling(c);
    if (c.kind == RowKind::kContact && heavy > 0.0)
      longest =
          std::min(longest, sag_time[index] * std::sqrt(stiffest_rigid(bound) * heavy / light));
    if (materials[index].from_solref)
      longest = std::max(longest,
                         longest_solref_microstep(solref_rate(rows, c, materials[index]), bound));
    h = std::min(h, longest);
  }
  return h;
}

double Islands::rigid_coupling(const RowGroup& c) const {
  double coupling = 0.0;
  for (int tree : c.tree)
    if (tree >= 0) coupling = std::max(coupling, bounds_[tree].rigid / bounds_[tree].rigid_share());
  return coupling;
}

// Fixes every row for micro-steps of h; returns how many rows of an SI material or a solref had to
// be lowered.
int Islands::fill(const Island& island, Rows& rows, const std::vector<GroupMaterial>& materials,
                  double h) {
  int clipped = 0;
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    double stiffness_scale = 1.0, damping_scale = 1.0;
    for (int side = 0; side < 2; ++side) {
      if (c.tree[side] < 0) continue;
      const TreeBounds& b = bounds_[c.tree[side]];
      const double share = b.si_share();
      stiffness_scale =
          std::min(stiffness_scale, limit(share * std::pow(kResolution / h, 2), b.stiffness));
      damping_scale = std::min(damping_scale, limit(share * kResolution / h, b.damping));
    }
    if (materials[index].rigid()) {
      if (!fill_rigid_rows(rows, c, materials[index], rigid_coupling(c), h)) clipped += c.dim;
      continue;
    }
    if (stiffness_scale == 1.0 && damping_scale == 1.0) continue;
    for (int row = c.row; row < c.row + c.dim; ++row) {
      rows.stiffness[row] *= stiffness_scale;
      rows.damping[row] *= damping_scale;
    }
    clipped += c.dim;
  }
  return clipped;
}

}  // namespace dashpot
