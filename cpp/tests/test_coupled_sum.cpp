// Inverse masses and bounds of rows over a random tree, by mass-weighted rows, against dense
// products with its inverse inertia.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "dashpot/islands/coupled_sum.hpp"
#include "dashpot/rows/mass_weighted.hpp"

namespace {

using namespace dashpot;

int failures = 0;

void check_close(double value, double expected, const char* claim) {
  // Rounding grows with the condition of the inertia, at most 1e6 here.
  if (std::abs(value - expected) <= 1e-9 * std::abs(expected)) return;
  std::printf("%s: %.17g, expected %.17g\n", claim, value, expected);
  ++failures;
}

std::mt19937 generator(11);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
int below(int count) { return std::min(count - 1, static_cast<int>(uniform(0, count))); }

// A tree of `n` links, each below any of those before it, behind one of a single degree of freedom;
// its inertia L' D L is known by its factor.
Trees random_tree(int n) {
  Trees trees;
  const int alone[] = {-1};
  trees.append(0, 1, false, alone);
  std::vector<int> above(n, -1);
  for (int i = 1; i < n; ++i) above[i] = 1 + below(i);
  trees.append(1, n, false, above.data());
  double* factor = trees.factor.data() + trees.tree[1].inverse;
  for (int k = 0; k < n; ++k) {
    factor[k * n + k] = std::exp(uniform(-2.0, 2.0));
    for (int i = above[k]; i >= 0; i = trees.above[i]) factor[k * n + i - 1] = uniform(-0.5, 0.5);
  }
  invert_inertia(trees, 1, factor);
  return trees;
}

using Matrix = Eigen::MatrixXd;

double spectral_radius(const Matrix& symmetric) {
  return Eigen::SelfAdjointEigenSolver<Matrix>(symmetric).eigenvalues().cwiseAbs().maxCoeff();
}

// Rounds of the bound end where one takes off less than a hundredth; of slow convergence some are
// left to go.
constexpr double kSlack = 1.15;

// `bound` is one on the eigenvalues of C, and near to the least one of |C|.
void check_bound(double bound, const Matrix& c, const char* claim) {
  const double largest = spectral_radius(c), least_bound = spectral_radius(c.cwiseAbs());
  if (bound >= largest * (1.0 - 1e-9) && bound <= kSlack * least_bound) return;
  std::printf("%s: %.17g of eigenvalues up to %.17g, at best %.17g\n", claim, bound, largest,
              least_bound);
  ++failures;
}

// Both ends of the range of each of `n` joints, of which the stiffer counts.
void check_ends_of_ranges(int n) {
  const Trees trees = random_tree(n);
  const Tree& t = trees.tree[1];
  Rows rows;
  rows.reset(2 * n);
  CoupledSum sum, other;
  CoupledSum::Room room;
  room.fit(trees);
  sum.reset(trees);
  other.reset(trees);
  Matrix root = Matrix::Zero(n, n), inverse(n, n);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) inverse(i, j) = trees.inverse[t.inverse + i * t.count + j];
    for (double sign : {1.0, -1.0}) {
      RowGroup& c = rows.append(RowKind::kUnilateral, 2 * i, 1, {1, -1});
      c.columns[0] = 1;
      c.is_end_of_range = true;
      rows.column.push_back(t.begin + i);
      rows.value.push_back(sign);
      const double weight = uniform(0.1, 3.0);
      root(i, i) = std::max(root(i, i), std::sqrt(weight));
      sum.add(rows, trees, c, 0, 0, 1, &weight);
    }
  }
  const Matrix similar = root * inverse * root;
  check_bound(sum.replace(trees, 1, other, room), similar, "bound of ends of ranges");
  check_bound(other.take_bound(trees, 1, room), similar, "bound of ends handed over");
  if (!sum.empty(1) || other.take_bound(trees, 1, room) != 0.0) {
    std::printf("sums of ends are empty after their bounds were taken\n");
    ++failures;
  }
}

// `wide` groups of several coordinates and `narrow` ones of one. The first row of every group goes
// to one sum, the others to another, which takes over what is in the first.
void check_tree(int n, int wide, int narrow) {
  const Trees trees = random_tree(n);
  const Tree& t = trees.tree[1];
  Matrix inverse(n, n), weighted = Matrix::Identity(n, n), first_sum = Matrix::Zero(n, n),
                        all_sum = Matrix::Zero(n, n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      inverse(i, j) = trees.inverse[t.inverse + i * t.count + j];
      if (j < i) weighted(i, j) = trees.factor[t.inverse + i * n + j];
    }
  // H = weighted' weighted
  for (int i = 0; i < n; ++i) weighted.row(i) /= trees.inverse_root[t.begin + i];
  Rows rows;
  rows.reset(kMaxRows * (wide + narrow));
  CoupledSum first, others;
  CoupledSum::Room room;
  room.fit(trees);
  first.reset(trees);
  others.reset(trees);
  for (int group = 0; group < wide + narrow; ++group) {
    const int dims[] = {1, 3, 4, 6};
    const int dim = group < wide ? dims[below(4)] : 1;
    RowGroup& c = rows.append(RowKind::kContact, group, dim, {1, -1});
    std::vector<int> dofs;
    for (int i = 0; i < n; ++i)
      if (group < wide && uniform(0.0, 1.0) < 0.3) dofs.push_back(i);
    if (dofs.empty()) dofs.push_back(below(n));
    c.columns[0] = static_cast<int>(dofs.size());
    for (int dof : dofs) rows.column.push_back(t.begin + dof);
    Matrix row = Matrix::Zero(dim, n);
    for (int i = 0; i < dim; ++i)
      for (int dof : dofs) {
        row(i, dof) = uniform(-2.0, 2.0);
        rows.value.push_back(row(i, dof));
      }
    append_mass_weighted(rows, c, trees);
    find_inverse_mass(rows, c, trees);
    double weight[kMaxRows];
    for (int i = 0; i < dim; ++i) {
      weight[i] = uniform(0.1, 3.0);
      const Matrix term = weight[i] * row.row(i).transpose() * row.row(i);
      all_sum += term;
      if (i == 0) first_sum += term;
      const double inverse_mass = row.row(i) * inverse * row.row(i).transpose();
      check_close(rows.inverse_mass[c.row + i], inverse_mass, "inverse mass");
    }
    first.add(rows, trees, c, 0, 0, 1, weight);
    if (dim > 1) others.add(rows, trees, c, 0, 1, dim - 1, weight + 1);
  }
  // Of rows of one coordinate each, by joint: C = K^1/2 inv(H) K^1/2.
  const auto similar = [&](const Matrix& sum) -> Matrix {
    const Matrix to_mass = weighted.inverse();
    if (wide > 0) return to_mass.transpose() * sum * to_mass;
    const Matrix root = sum.diagonal().cwiseSqrt().asDiagonal();
    return root * inverse * root;
  };
  check_bound(first.replace(trees, 1, others, room), similar(first_sum), "bound of first rows");
  check_bound(others.take_bound(trees, 1, room), similar(all_sum), "bound of all rows");
  if (!first.empty(1) || !others.empty(1) || others.take_bound(trees, 1, room) != 0.0) {
    std::printf("sums are empty after their bounds were taken\n");
    ++failures;
  }
}

}  // namespace

int main() {
  for (int n = 1; n <= 30; ++n) {
    check_ends_of_ranges(n);
    for (int wide : {0, 1, 5})
      for (int narrow : {0, 1, 7})
        if (wide + narrow > 0) check_tree(n, wide, narrow);
  }
  return failures == 0 ? 0 : 1;
}
