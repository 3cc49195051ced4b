// The sparse factor, solution and inverse of the inertia of random trees, against dense products.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <vector>

#include "dashpot/rows/trees.hpp"

namespace {

using namespace dashpot;

int failures = 0;

void check_close(double value, double expected, double scale, double tolerance, const char* claim) {
  if (std::abs(value - expected) <= tolerance * scale) return;
  std::printf("%s: %.17g, expected %.17g\n", claim, value, expected);
  ++failures;
}

std::mt19937 generator(7);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}

// A chain of `n` links, or where `branching` every link below any of those before it. A tree of one
// degree of freedom comes first, so that numbers of all and of the tree differ.
Trees random_trees(int n, bool branching) {
  Trees trees;
  const int alone[] = {-1};
  trees.append(0, 1, false, alone);
  std::vector<int> above(n);
  for (int i = 0; i < n; ++i) {
    const int lowest = branching ? std::min(i - 1, static_cast<int>(uniform(0, i))) : i - 1;
    above[i] = i == 0 ? -1 : 1 + lowest;
  }
  trees.append(1, n, false, above.data());
  return trees;
}

// H = L' D L with entries of L where one degree of freedom is above the other.
std::vector<double> random_inertia(const Trees& trees, int n) {
  std::vector<double> lower(n * n, 0.0), inertia(n * n, 0.0);
  for (int k = 0; k < n; ++k) {
    lower[k * n + k] = 1.0;
    for (int i = trees.above[1 + k]; i >= 0; i = trees.above[i])
      lower[k * n + i - 1] = uniform(-0.5, 0.5);
  }
  for (int k = 0; k < n; ++k) {
    const double d = std::exp(uniform(-2.0, 2.0));
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) inertia[i * n + j] += lower[k * n + i] * d * lower[k * n + j];
  }
  return inertia;
}

void check_inertia(int n, bool branching) {
  Trees trees = random_trees(n, branching);
  const std::vector<double> inertia = random_inertia(trees, n);
  std::vector<double> factor = inertia, x(n), force(n, 0.0);
  if (!factor_inertia(trees, 1, factor.data())) {
    std::printf("an inertia of %d degrees of freedom was not factored\n", n);
    ++failures;
  }
  invert_inertia(trees, 1, factor.data());
  const Tree& t = trees.tree[1];
  const double* inverse = trees.inverse.data() + t.inverse;
  for (double& entry : x) entry = uniform(-1.0, 1.0);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) force[i] += inertia[i * n + j] * x[j];
  solve_inertia(trees, 1, factor.data(), force.data());
  // Rounding grows with the condition, at most 1e6 here, and the length of the sums.
  for (int i = 0; i < n; ++i) check_close(force[i], x[i], 1.0, 1e-9, "solution");
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      double product = 0.0;
      for (int k = 0; k < n; ++k) product += inverse[i * t.count + k] * inertia[k * n + j];
      check_close(product, i == j ? 1.0 : 0.0, 1.0, 1e-9, "inverse times inertia");
    }
  for (int i = 0; i < t.count; ++i)
    for (int j = 0; j < t.count; ++j)
      if (i >= n || j >= n)
        check_close(inverse[i * t.count + j], 0.0, 1.0, 0.0, "inverse beyond the tree");
}

void check_indefinite() {
  Trees trees = random_trees(3, false);
  std::vector<double> inertia = random_inertia(trees, 3);
  inertia[0] = -1.0;
  if (!factor_inertia(trees, 1, inertia.data())) return;
  std::printf("an inertia that is not positive definite was factored\n");
  ++failures;
}

}  // namespace

int main() {
  for (int n = 1; n <= 45; ++n)
    for (bool branching : {false, true}) check_inertia(n, branching);
  check_indefinite();
  return failures == 0 ? 0 : 1;
}
