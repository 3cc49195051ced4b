#include "definite_damping.hpp"

#include <mujoco/mujoco.h>

#include <cmath>
#include <vector>

namespace dashpot::host {

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

}  // namespace dashpot::host
