#include "dashpot/islands.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace dashpot {

namespace {

constexpr int kLargeTree = 12;        // degrees of freedom above which S_T is not squared
constexpr double kRigidMaxRatio = 5;  // damping ratio standing for restitution 0 (e < 0.01)
constexpr double kMaxRatio = 50;      // the same for SI stiffness (e < 1e-4)

// S_T of one tree for one diagonal (stiffness, damping or unit): lower triangle, row-major.
class CoupledBound {
 public:
  explicit CoupledBound(int dofs) : dofs_(dofs), sum_(dofs * dofs, 0.0) {}

  void add(const double* block, double weight) {
    empty_ = false;
    double* entry = sum_.data();
    for (int i = 0; i < dofs_; ++i, entry += dofs_) {
      const double scaled = weight * block[i];
      for (int j = 0; j <= i; ++j) entry[j] += scaled * block[j];
    }
  }

  double largest_eigenvalue_bound() const {
    if (empty_) return 0.0;
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const Matrix> lower(sum_.data(), dofs_, dofs_);
    const double trace = lower.trace();
    if (trace == 0.0) return 0.0;
    if (dofs_ == 6) return fourth_power_bound<6>(lower, trace);
    const Matrix full = lower.selfadjointView<Eigen::Lower>();
    if (dofs_ <= kLargeTree) return fourth_power_bound<Eigen::Dynamic>(full, trace);
    return std::min(full.norm(), full.cwiseAbs().rowwise().sum().maxCoeff());
  }

 private:
  template <int Size, typename Lower>
  static double fourth_power_bound(const Lower& lower, double trace) {
    using Matrix = Eigen::Matrix<double, Size, Size>;
    const Matrix full = Matrix(lower.template selfadjointView<Eigen::Lower>()) / trace;
    const Matrix square = full * full;
    return trace * std::pow((square * square).norm(), 0.25);
  }

  int dofs_;
  std::vector<double> sum_;
  bool empty_ = true;
};

// Bounds of one tree: SI stiffness, SI damping, and rigid rows weighted by 1/w.
struct TreeBounds {
  double stiffness = 0.0, damping = 0.0, rigid = 0.0;
  bool mixed() const { return rigid > 0.0 && (stiffness > 0.0 || damping > 0.0); }
  // Part of the resolution that SI rows may use, and that rigid rows may use.
  double si_share() const { return rigid > 0.0 ? 0.5 : 1.0; }
  double rigid_share() const { return mixed() ? 0.5 : 1.0; }
};

// Inverse mass that the stiffness of friction row i divides by: of the two sliding or the two
// rolling rows the larger, so that springs are isotropic whatever the tangents are.
template <typename InverseMass>
double isotropic_inverse_mass(const RowGroup& c, int i, InverseMass inverse_mass) {
  if (i == 3) return inverse_mass(c.row + 3);
  const int first = c.row + (i < 3 ? 1 : 4);
  return std::max(inverse_mass(first), inverse_mass(first + 1));
}

// Stiffness and damping of a group's rows, before clipping. Rotational rows get the stiffness that
// gives them the natural frequency of the sliding rows.
void fill_given_rows(Rows& rows, const RowGroup& c, const GroupMaterial& given) {
  const Material& material = given.material;
  const int n = c.row;
  const double w_normal = rows.inverse_mass[n];
  if (given.mass_normalised) {
    const double w = rows.bounded_inverse_mass(n);
    rows.stiffness[n] = w > 0.0 ? given.normalised_stiffness / w : 1.0;
    rows.damping[n] = w > 0.0 ? given.normalised_damping / w : 0.0;
  } else {
    rows.stiffness[n] = material.stiffness;
    const double damping =
        w_normal > 0.0 ? damping_of(material, material.stiffness, w_normal) : 0.0;
    rows.damping[n] = std::isfinite(damping)
                          ? damping
                          : 2.0 * kMaxRatio * std::sqrt(material.stiffness / w_normal);
  }
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

// Rigid rows: k = kappa / w, d = delta / w. With c the bound of the unit-weighted rows, diag(A) = 1
// in these units, the flow of every row on its own is exact and only the coupling c - 1 has to be
// resolved:
//     kappa (c - 1) h^2 <= theta^2,   delta (c - 1) h <= theta,   kappa h^2 <= 1 .
// A damping ratio is that of the stiffest coupled mode, delta = 2 zeta sqrt(kappa / c), as far as
// the second bound allows; a restitution is that of the contact alone, delta = 2 zeta sqrt(kappa),
// for which kappa gives way.
void fill_rigid_rows(Rows& rows, const RowGroup& c, const Material& material, double bound,
                     double h) {
  const double coupling = std::max(0.0, bound - 1.0);
  const double stiffest =
      std::min(1.0, coupling > 0.0 ? kRigidResolution * kRigidResolution / coupling : 1.0) /
      (h * h);
  const double most_damped =
      coupling > 0.0 ? kRigidResolution / (h * coupling) : std::numeric_limits<double>::infinity();
  // By the bound on w: k = kappa / w would turn the frozen geometry's error near a singular
  // configuration into arbitrary forces.
  const auto fill = [&](int row, double kappa, double delta) {
    const double w = rows.bounded_inverse_mass(row);
    // Where nothing moves along a row, any positive stiffness carries its zero load.
    rows.stiffness[row] = w > 0.0 ? kappa / w : 1.0;
    rows.damping[row] = w > 0.0 ? delta / w : 0.0;
  };
  const auto fill_coupled = [&](int row, double zeta, double kappa) {
    fill(row, kappa, std::min(2.0 * zeta * std::sqrt(kappa / bound), most_damped));
  };
  if (material.form == DampingForm::kRestitution) {
    const double zeta = std::min(restitution_to_damping_ratio(material.damping), kRigidMaxRatio);
    const double kappa =
        zeta > 0.0 ? std::min(stiffest, std::pow(most_damped / (2.0 * zeta), 2)) : stiffest;
    fill(c.row, kappa, 2.0 * zeta * std::sqrt(kappa));
  } else {
    fill_coupled(c.row, material.damping, stiffest);
  }
  const auto inverse_mass = [&](int row) { return rows.bounded_inverse_mass(row); };
  for (int i = 1; i < c.dim; ++i) {
    const double w = inverse_mass(c.row + i);
    const double kappa =
        w > 0.0 ? stiffest * w / isotropic_inverse_mass(c, i, inverse_mass) : stiffest;
    fill_coupled(c.row + i, material.tangential_damping_ratio, kappa);
  }
}

class Planner {
 public:
  Planner(const Island& island, Rows& rows, const Trees& trees,
          const std::vector<GroupMaterial>& materials)
      : island_(island), rows_(rows), trees_(trees), materials_(materials) {
    bounds_.resize(island.tree.size());
    for (int index : island.group)
      if (!materials[index].rigid()) fill_given_rows(rows, rows.group[index], materials[index]);
    measure();
  }

  // Longest micro-step that resolves every SI value.
  double longest_si_microstep() const {
    double h = std::numeric_limits<double>::infinity();
    for (const TreeBounds& b : bounds_) {
      if (b.stiffness > 0.0) h = std::min(h, kResolution * std::sqrt(b.si_share() / b.stiffness));
      if (b.damping > 0.0) h = std::min(h, kResolution * b.si_share() / b.damping);
    }
    return h;
  }

  bool has_rigid() const {
    return std::any_of(island_.group.begin(), island_.group.end(),
                       [&](int index) { return materials_[index].rigid(); });
  }

  // Fixes every row for micro-steps of h; returns how many SI rows had to be lowered.
  int fill(double h) {
    int clipped = 0;
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      double stiffness_scale = 1.0, damping_scale = 1.0, coupling = 0.0;
      for (int side = 0; side < 2; ++side) {
        if (c.tree[side] < 0) continue;
        const TreeBounds& b = bounds_[slot(c.tree[side])];
        const double share = b.si_share();
        stiffness_scale =
            std::min(stiffness_scale, limit(share * std::pow(kResolution / h, 2), b.stiffness));
        damping_scale = std::min(damping_scale, limit(share * kResolution / h, b.damping));
        coupling = std::max(coupling, b.rigid / b.rigid_share());
      }
      if (materials_[index].rigid()) {
        fill_rigid_rows(rows_, c, materials_[index].material, coupling, h);
        continue;
      }
      if (stiffness_scale == 1.0 && damping_scale == 1.0) continue;
      for (int row = c.row; row < c.row + c.dim; ++row) {
        rows_.stiffness[row] *= stiffness_scale;
        rows_.damping[row] *= damping_scale;
      }
      clipped += c.dim;
    }
    return clipped;
  }

 private:
  static double limit(double allowed, double bound) {
    return bound > allowed ? allowed / bound : 1.0;
  }

  size_t slot(int tree) const {
    return std::lower_bound(island_.tree.begin(), island_.tree.end(), tree) - island_.tree.begin();
  }

  void measure() {
    std::vector<CoupledBound> stiffness, damping, rigid;
    for (int tree : island_.tree) {
      const int dofs = trees_.tree[tree].dof_count;
      stiffness.emplace_back(dofs);
      damping.emplace_back(dofs);
      rigid.emplace_back(dofs);
    }
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      for (int i = 0; i < c.dim; ++i) {
        const int row = c.row + i;
        const double* blocks = rows_.jacobian.data() + c.jacobian + i * c.stride;
        const double* block[2] = {blocks, blocks + c.dof_count[0]};
        double norm[2];
        for (int side = 0; side < 2; ++side)
          norm[side] = Eigen::Map<const Eigen::VectorXd>(block[side], c.dof_count[side]).norm();
        for (int side = 0; side < 2; ++side) {
          if (norm[side] == 0.0) continue;
          const double split = 1.0 + norm[1 - side] / norm[side];
          const size_t s = slot(c.tree[side]);
          if (materials_[index].rigid()) {
            rigid[s].add(block[side], split / rows_.inverse_mass[row]);
          } else {
            stiffness[s].add(block[side], split * rows_.stiffness[row]);
            damping[s].add(block[side], split * rows_.damping[row]);
          }
        }
      }
    }
    for (size_t s = 0; s < bounds_.size(); ++s)
      bounds_[s] = {stiffness[s].largest_eigenvalue_bound(), damping[s].largest_eigenvalue_bound(),
                    rigid[s].largest_eigenvalue_bound()};
  }

  const Island& island_;
  Rows& rows_;
  const Trees& trees_;
  const std::vector<GroupMaterial>& materials_;
  std::vector<TreeBounds> bounds_;  // in the order of island.tree
};

}  // namespace

std::vector<Island> find_islands(const Rows& rows, const Trees& trees) {
  std::vector<int> root(trees.tree.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int tree) {
    while (root[tree] != tree) tree = root[tree] = root[root[tree]];
    return tree;
  };
  for (const RowGroup& c : rows.group)
    if (c.tree[0] >= 0 && c.tree[1] >= 0) {
      const int a = find(c.tree[0]), b = find(c.tree[1]);
      root[std::max(a, b)] = std::min(a, b);
    }
  std::vector<int> island_of(trees.tree.size(), -1);
  std::vector<Island> islands;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    const int tree = find(c.tree[0] >= 0 ? c.tree[0] : c.tree[1]);
    if (island_of[tree] < 0) {
      island_of[tree] = static_cast<int>(islands.size());
      islands.emplace_back();
    }
    islands[island_of[tree]].group.push_back(static_cast<int>(i));
  }
  for (size_t tree = 0; tree < trees.tree.size(); ++tree) {
    const int island = island_of[find(static_cast<int>(tree))];
    if (island >= 0) islands[island].tree.push_back(static_cast<int>(tree));
  }
  return islands;
}

void plan_microsteps(Island& island, Rows& rows, const Trees& trees,
                     const std::vector<GroupMaterial>& materials, double step,
                     const Options& options) {
  Planner planner(island, rows, trees, materials);
  double count = options.microsteps;
  if (options.microsteps == 0) {
    count = std::max<double>(kMinimumMicrosteps, step / planner.longest_si_microstep());
    if (planner.has_rigid()) count = std::max(count, step / kRigidMicrostep);
  }
  // Rounding up must not add a micro-step for the last bit of a quotient.
  island.microsteps =
      static_cast<int>(std::ceil(std::min<double>(count, options.max_microsteps) * (1.0 - 1e-12)));
  island.duration = step / island.microsteps;
  island.clipped = planner.fill(island.duration);
}

}  // namespace dashpot
