#include "dashpot/rows.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>

namespace dashpot {

namespace {

constexpr double kSingular = 0.01;  // part of the typical inverse mass that counts as singular

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Vector = Eigen::Map<Eigen::VectorXd>;
using ConstVector = Eigen::Map<const Eigen::VectorXd>;

using ConstFactor = Eigen::Map<const RowMajor>;

ConstFactor factor_of(const Trees& trees, int tree) {
  const Tree& t = trees.tree[tree];
  return ConstFactor(trees.factor.data() + t.factor, t.dof_count, t.dof_count);
}

// Forward substitution with a factor of fixed size.
void solve_six(const double* factor, double* x) {
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < i; ++j) x[i] -= factor[6 * i + j] * x[j];
    x[i] /= factor[6 * i + i];
  }
}

void solve_lower(const Trees& trees, int tree, double* x) {
  const Tree& t = trees.tree[tree];
  if (t.dof_count == 6) return solve_six(trees.factor.data() + t.factor, x);
  Vector block(x, t.dof_count);
  factor_of(trees, tree).triangularView<Eigen::Lower>().solveInPlace(block);
}

}  // namespace

double Rows::bounded_inverse_mass(int row) const {
  return std::max(inverse_mass[row], kSingular * typical_inverse_mass[row]);
}

void Rows::clear() {
  group.clear();
  jacobian.clear();
  inverse_mass.clear();
  typical_inverse_mass.clear();
  stiffness.clear();
  damping.clear();
  friction.clear();
}

RowGroup& Rows::append(RowKind kind, int input, int dim, const Trees& trees,
                       std::array<int, 2> tree) {
  // Two bodies of one tree share a single block.
  if (tree[0] == tree[1]) tree[1] = -1;
  RowGroup c;
  c.kind = kind;
  c.input = input;
  c.dim = dim;
  c.row = static_cast<int>(inverse_mass.size());
  c.jacobian = static_cast<int>(jacobian.size());
  c.tree = tree;
  for (int side = 0; side < 2; ++side) {
    if (tree[side] < 0) continue;
    c.dof_begin[side] = trees.tree[tree[side]].dof_begin;
    c.dof_count[side] = trees.tree[tree[side]].dof_count;
  }
  c.stride = c.dof_count[0] + c.dof_count[1];
  jacobian.resize(jacobian.size() + dim * c.stride, 0.0);
  for (auto* array : {&inverse_mass, &typical_inverse_mass, &stiffness, &damping, &friction})
    array->resize(array->size() + dim, 0.0);
  group.push_back(c);
  return group.back();
}

void factor_inertia(Trees& trees, int tree, const std::vector<double>& inertia) {
  const Tree& t = trees.tree[tree];
  Eigen::Map<RowMajor> factor(trees.factor.data() + t.factor, t.dof_count, t.dof_count);
  factor = Eigen::Map<const RowMajor>(inertia.data(), t.dof_count, t.dof_count);
  Eigen::LLT<Eigen::Ref<RowMajor>> llt(factor);
  if (llt.info() != Eigen::Success)
    throw std::runtime_error("effective inertia of kinematic tree " + std::to_string(tree) +
                             " is not positive definite");
}

void whiten(Rows& rows, const RowGroup& c, const Trees& trees) {
  for (int i = 0; i < c.dim; ++i) {
    double* row = rows.jacobian.data() + c.jacobian + i * c.stride;
    if (c.tree[0] >= 0) solve_lower(trees, c.tree[0], row);
    if (c.tree[1] >= 0) solve_lower(trees, c.tree[1], row + c.dof_count[0]);
    rows.inverse_mass[c.row + i] = ConstVector(row, c.stride).squaredNorm();
  }
}

void whiten_velocity(const Trees& trees, int tree, const double* velocity, double* whitened) {
  const int n = trees.tree[tree].dof_count;
  Vector(whitened, n) =
      factor_of(trees, tree).transpose().triangularView<Eigen::Upper>() * ConstVector(velocity, n);
}

void unwhiten_velocity(const Trees& trees, int tree, const double* whitened, double* velocity) {
  const int n = trees.tree[tree].dof_count;
  Vector(velocity, n) = factor_of(trees, tree)
                            .transpose()
                            .triangularView<Eigen::Upper>()
                            .solve(ConstVector(whitened, n));
}

void generalized_impulse(const Trees& trees, int tree, const double* whitened, double* impulse) {
  const int n = trees.tree[tree].dof_count;
  Vector(impulse, n) =
      factor_of(trees, tree).triangularView<Eigen::Lower>() * ConstVector(whitened, n);
}

void whiten_force(const Trees& trees, int tree, const double* force, double* whitened) {
  const int n = trees.tree[tree].dof_count;
  Vector(whitened, n) =
      factor_of(trees, tree).triangularView<Eigen::Lower>().solve(ConstVector(force, n));
}

}  // namespace dashpot
