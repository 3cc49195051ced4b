// Inverse masses and bounds of rows over a random tree, by mass-weighted rows, against dense
// products with its inverse inertia.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "dashpot/coupled_sum.hpp"

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

using Matrix = std::vector<double>;  // n x n
Matrix product(const Matrix& a, const Matrix& b, int n) {
  Matrix c(n * n, 0.0);
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k)
      for (int j = 0; j < n; ++j) c[i * n + j] += a[i * n + k] * b[k * n + j];
  return c;
}

// trace((inv(H) S)^4)^(1/4).
double dense_bound(const Matrix& inverse, const Matrix& sum, int n) {
  const Matrix b = product(inverse, sum, n), square = product(b, b, n);
  double trace = 0.0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) trace += square[i * n + j] * square[j * n + i];
  return std::pow(trace, 0.25);
}

// `wide` groups of several coordinates and `narrow` ones of one. The first row of every group goes
// to one sum, the others to another, which takes over what is in the first.
void check_tree(int n, int wide, int narrow) {
  const Trees trees = random_tree(n);
  const Tree& t = trees.tree[1];
  Matrix inverse(n * n), first_sum(n * n, 0.0), all_sum(n * n, 0.0);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) inverse[i * n + j] = trees.inverse[t.inverse + i * t.count + j];
  Rows rows;
  rows.reset(kMaxRows * (wide + narrow));
  CoupledSum first, others;
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
    Matrix row(dim * n, 0.0);
    for (int i = 0; i < dim; ++i)
      for (int dof : dofs) {
        row[i * n + dof] = uniform(-2.0, 2.0);
        rows.value.push_back(row[i * n + dof]);
      }
    find_inverse_mass(rows, c, trees);
    double weight[kMaxRows];
    for (int i = 0; i < dim; ++i) {
      double inverse_mass = 0.0;
      weight[i] = uniform(0.1, 3.0);
      for (int k = 0; k < n; ++k)
        for (int l = 0; l < n; ++l) {
          inverse_mass += row[i * n + k] * inverse[k * n + l] * row[i * n + l];
          const double term = weight[i] * row[i * n + k] * row[i * n + l];
          all_sum[k * n + l] += term;
          if (i == 0) first_sum[k * n + l] += term;
        }
      check_close(rows.inverse_mass[c.row + i], inverse_mass, "inverse mass");
    }
    first.add(rows, trees, c, 0, 0, 1, weight);
    if (dim > 1) others.add(rows, trees, c, 0, 1, dim - 1, weight + 1);
  }
  check_close(first.hand_over(trees, 1, others), dense_bound(inverse, first_sum, n),
              "bound of first rows");
  check_close(others.take_bound(trees, 1), dense_bound(inverse, all_sum, n), "bound of all rows");
  if (!first.empty(1) || !others.empty(1) || others.take_bound(trees, 1) != 0.0) {
    std::printf("sums are empty after their bounds were taken\n");
    ++failures;
  }
}

}  // namespace

int main() {
  for (int n = 1; n <= 30; ++n)
    for (int wide : {0, 1, 5})
      for (int narrow : {0, 1, 7})
        if (wide + narrow > 0) check_tree(n, wide, narrow);
  return failures == 0 ? 0 : 1;
}
