#include "dashpot/trees.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <string>

#include "dashpot/lanes.hpp"

namespace dashpot {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

}  // namespace

void Trees::append(int dof_begin, int dof_count, bool free_body) {
  Tree t;
  t.dof_begin = dof_begin;
  t.dof_count = dof_count;
  t.begin = coordinates;
  t.count = free_body ? kBodyCoordinates : (dof_count + kLanes - 1) / kLanes * kLanes;
  t.free_body = free_body;
  t.inverse = static_cast<int>(inverse.size());
  coordinates += t.count;
  inverse.resize(inverse.size() + t.count * t.count, 0.0);
  tree.push_back(t);
}

void add_response(const Trees& trees, int tree, const double* force, double* acceleration) {
  const Tree& t = trees.tree[tree];
  const double* column = trees.inverse.data() + t.inverse;
  if (t.free_body) {
    for (int i = 0; i < 3; ++i) acceleration[i] += column[i] * force[i];
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) acceleration[4 + i] += column[4 * (j + 1) + i] * force[4 + j];
    return;
  }
  for (int j = 0; j < t.dof_count; ++j, column += t.count)
    for (int i = 0; i < t.dof_count; ++i) acceleration[i] += column[i] * force[j];
}

void factor_inertia(int tree, int dofs, double* inertia) {
  Eigen::Map<RowMajor> factor(inertia, dofs, dofs);
  Eigen::LLT<Eigen::Ref<RowMajor>> llt(factor);
  if (llt.info() != Eigen::Success)
    throw std::runtime_error("effective inertia of kinematic tree " + std::to_string(tree) +
                             " is not positive definite");
}

void solve_inertia(int dofs, const double* factor, double* x) {
  const Eigen::Map<const RowMajor> lower(factor, dofs, dofs);
  Eigen::Map<Eigen::VectorXd> solution(x, dofs);
  lower.triangularView<Eigen::Lower>().solveInPlace(solution);
  lower.transpose().triangularView<Eigen::Upper>().solveInPlace(solution);
}

void invert_inertia(Trees& trees, int tree, const double* factor) {
  const Tree& t = trees.tree[tree];
  const int n = t.dof_count;
  double* inverse = trees.inverse.data() + t.inverse;
  std::fill(inverse, inverse + t.count * t.count, 0.0);
  // The columns of inv(L) by forward substitution, then inv(H) = inv(L)' inv(L).
  for (int j = 0; j < n; ++j) {
    double* column = inverse + j * t.count;
    column[j] = 1.0 / factor[j * n + j];
    for (int i = j + 1; i < n; ++i) {
      double sum = 0.0;
      for (int k = j; k < i; ++k) sum += factor[i * n + k] * column[k];
      column[i] = -sum / factor[i * n + i];
    }
  }
  // In place: above the diagonal of column j there is room, and its own entry j is read before.
  for (int i = 0; i < n; ++i)
    for (int j = i; j < n; ++j) {
      double sum = 0.0;
      for (int k = j; k < n; ++k) sum += inverse[i * t.count + k] * inverse[j * t.count + k];
      inverse[j * t.count + i] = sum;
    }
  for (int i = 0; i < n; ++i)
    for (int j = i + 1; j < n; ++j) inverse[i * t.count + j] = inverse[j * t.count + i];
}

}  // namespace dashpot
