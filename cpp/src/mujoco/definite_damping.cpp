#include "definite_damping.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/LU>
#include <cmath>
#include <vector>

namespace dashpot::host {

namespace {

// Reciprocal condition of M + h D from which on MuJoCo's own solution is rounding.
constexpr double kSingularDerivatives = 1e-14;

}  // namespace

void keep_what_damps(const mjModel_* m, mjData_* d, int tree) {
  const int begin = m->tree_dofadr[tree], end = begin + m->tree_dofnum[tree];
  thread_local std::vector<double> size;  // kept by the thread: a step allocates nothing
  size.assign(end - begin, 0.0);
  for (int i = begin; i < end; ++i)
    for (int k = m->M_rowadr[i]; k < m->M_rowadr[i] + m->M_rownnz[i]; ++k) {
      mjtNum& entry = d->qDeriv[m->mapD2M[k]];
      const int j = m->M_colind[k];
      size[i - begin] += std::abs(entry);
      if (i != j) size[j - begin] += std::abs(entry);
      entry = 0.0;
    }
  // The diagonal is the last of a row.
  for (int i = begin; i < end; ++i)
    d->qDeriv[m->mapD2M[m->M_rowadr[i] + m->M_rownnz[i] - 1]] = -size[i - begin];
}

bool solve_whole(const mjModel_* m, const mjData_* d, const Tree& t, double* acceleration) {
  thread_local Eigen::MatrixXd inertia;  // kept by the thread: a step allocates nothing
  inertia.setZero(t.dof_count, t.dof_count);
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    for (int k = m->M_rowadr[dof]; k < m->M_rowadr[dof] + m->M_rownnz[dof]; ++k) {
      const int j = m->M_colind[k] - t.dof_begin;
      inertia(i, j) += d->M[k];
      if (i != j) inertia(j, i) += d->M[k];
    }
    for (int k = m->D_rowadr[dof]; k < m->D_rowadr[dof] + m->D_rownnz[dof]; ++k)
      inertia(i, m->D_colind[k] - t.dof_begin) -= m->opt.timestep * d->qDeriv[k];
  }
  const Eigen::PartialPivLU<Eigen::Ref<Eigen::MatrixXd>> factors(inertia);
  if (!(factors.rcond() > kSingularDerivatives)) return false;
  using Force = Eigen::Map<const Eigen::VectorXd>;
  Eigen::Map<Eigen::VectorXd>(acceleration, t.dof_count) =
      factors.solve(Force(d->qfrc_smooth + t.dof_begin, t.dof_count));
  return true;
}

}  // namespace dashpot::host
