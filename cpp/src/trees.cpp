#include "dashpot/trees.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <stdexcept>
#include <string>

#include "dashpot/instruction_sets.hpp"
#include "dashpot/lane_blocks.hpp"
#include "dashpot/lanes.hpp"

namespace dashpot {

namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// inverse = inv(L L'), symmetric, `count` apart, a multiple of four. `lower`: room for inv(L),
// which is row-major and as wide.
DASHPOT_VECTOR_CLONES
void invert(const double* factor, int n, int count, double* lower, double* inverse) {
  std::fill_n(lower, count * count, 0.0);
  std::fill_n(inverse, count * count, 0.0);
  // Row i of inv(L) is what the rows above leave of the unit vector.
  for (int i = 0; i < n; ++i) {
    double* row = lower + i * count;
    row[i] = 1.0;
    const double scale = 1.0 / factor[i * n + i];
    const int filled = (i + kLanes) / kLanes * kLanes;
    for_each_block(
        filled, [=](int first, auto width) __attribute__((always_inline)) {
          Lanes rest[width()];
          load_block(row + first, rest);
          for (int k = first; k < i; ++k)
            add_scaled(lower + k * count + first, -factor[i * n + k], rest);
          for (Lanes& r : rest) r *= scale;
          store_block(rest, row + first);
        });
  }
  // inv(H) = inv(L)' inv(L): its lower triangle, and what mirrors it.
  for (int i = 0; i < n; ++i) {
    const int filled = (i + kLanes) / kLanes * kLanes;
    for_each_block(
        filled, [=](int first, auto width) __attribute__((always_inline)) {
          Lanes sum[width()] = {};
          for (int k = i; k < n; ++k)
            add_scaled(lower + k * count + first, lower[k * count + i], sum);
          store_block(sum, inverse + i * count + first);
        });
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j) inverse[j * count + i] = inverse[i * count + j];
}

}  // namespace

void Trees::append(int dof_begin, int dof_count, bool free_body) {
  Tree t;
  t.dof_begin = dof_begin;
  t.dof_count = dof_count;
  if (free_body)
    coordinates = (coordinates + kBodyCoordinates - 1) / kBodyCoordinates * kBodyCoordinates;
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
  thread_local std::vector<double> lower;  // kept by the thread: no allocation in a step
  lower.resize(t.count * t.count);
  invert(factor, t.dof_count, t.count, lower.data(), trees.inverse.data() + t.inverse);
}

}  // namespace dashpot
