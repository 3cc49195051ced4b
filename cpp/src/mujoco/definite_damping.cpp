#include "definite_damping.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>
#include <cmath>

namespace dashpot::host {

namespace {

using Eigen::MatrixXd;

constexpr double kLeastShare = 0.5;  // of M, that 1 + h l leaves
constexpr int kMostDofs = 64;        // of trees whose eigenvalues are found

// Calls visit(i, j, k): entry k of M's in row i and column j <= i of a tree.
template <typename Visit>
void for_each_entry(const mjModel* m, int tree, const Visit& visit) {
  const int begin = m->tree_dofadr[tree];
  for (int i = 0; i < m->tree_dofnum[tree]; ++i) {
    const int first = m->M_rowadr[begin + i];
    for (int k = first; k < first + m->M_rownnz[begin + i]; ++k)
      visit(i, m->M_colind[k] - begin, k);
  }
}

bool has_branches(const mjModel* m, int tree) {
  const int begin = m->tree_dofadr[tree];
  for (int i = 0; i < m->tree_dofnum[tree]; ++i)
    if (m->M_rownnz[begin + i] != i + 1) return true;
  return false;
}

}  // namespace

void keep_what_damps(const mjModel_* m, mjData_* d, int tree) {
  const int n = m->tree_dofnum[tree];
  mjtNum* derivative = d->qDeriv;
  if (n > kMostDofs || has_branches(m, tree)) {
    Eigen::VectorXd size = Eigen::VectorXd::Zero(n);
    for_each_entry(m, tree, [&](int i, int j, int k) {
      double& entry = derivative[m->mapD2M[k]];
      size[i] += std::abs(entry);
      if (i != j) size[j] += std::abs(entry);
      entry = 0.0;
    });
    for_each_entry(m, tree, [&](int i, int j, int k) {
      if (i == j) derivative[m->mapD2M[k]] = -size[i];
    });
    return;
  }
  MatrixXd mass = MatrixXd::Zero(n, n), damping = mass;
  for_each_entry(m, tree, [&](int i, int j, int k) {
    mass(i, j) = mass(j, i) = d->M[k];
    damping(i, j) = damping(j, i) = -derivative[m->mapD2M[k]];
  });
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> found(damping, mass);
  if (found.info() != Eigen::Success) return;
  const MatrixXd columns = mass * found.eigenvectors();
  Eigen::VectorXd kept = found.eigenvalues();
  for (double& rate : kept)
    if (1.0 + m->opt.timestep * rate < kLeastShare) rate = 0.0;
  damping.noalias() = columns * kept.asDiagonal() * columns.transpose();
  for_each_entry(m, tree, [&](int i, int j, int k) { derivative[m->mapD2M[k]] = -damping(i, j); });
}

}  // namespace dashpot::host
