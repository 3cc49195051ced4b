#include "dashpot/model/springs_and_dampers.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/jacobians.hpp"
#include "dashpot/model/sleep.hpp"
#include "discrete.hpp"

namespace dashpot::host {

namespace {

double stiffness_of(const mjModel* m, int dof) {
  const int joint = m->dof_jntid[dof];
  const bool single = m->jnt_type[joint] == mjJNT_SLIDE || m->jnt_type[joint] == mjJNT_HINGE;
  if (!single || is_discrete(m) || (m->opt.disableflags & mjDSBL_SPRING)) return 0.0;
  const mjtNum* high_order = m->jnt_stiffnesspoly + mjNPOLY * joint;
  const bool linear =
      std::all_of(high_order, high_order + mjNPOLY, [](mjtNum value) { return value == 0.0; });
  return linear ? m->jnt_stiffness[joint] : 0.0;
}

constexpr double kWeak = 0.05;  // d w H up to which none is a row; fourteen edges meet in a vertex
constexpr int kMostTrees = 2;   // of a row

// Tendons have -1, -2 and so on, edges of flexes follow.
int source_of_edge(const mjModel* m, int edge) { return -1 - static_cast<int>(m->ntendon) - edge; }
int tendon_of(int source) { return -1 - source; }
int edge_of(const mjModel* m, int source) { return -1 - source - static_cast<int>(m->ntendon); }
bool is_tendon(const mjModel* m, int source) { return tendon_of(source) < m->ntendon; }

// Whether derivatives of smooth forces have all of a tendon's damping: not between branches.
bool is_derived(const mjModel* m, int tendon) {
  const int* const first = m->ten_J_colind + m->ten_J_rowadr[tendon];
  const int* const last = first + m->ten_J_rownnz[tendon];
  return std::all_of(first, last, [&](int one) {
    const int* const known = m->D_colind + m->D_rowadr[one];
    return std::all_of(first, last, [&](int other) {
      return std::find(known, known + m->D_rownnz[one], other) != known + m->D_rownnz[one];
    });
  });
}

bool is_strong(const mjModel* m, const RowDamper& damper) {
  const auto& [c, linear, square] = damper.coefficient;
  return std::min({c, linear, square}) >= 0.0 &&
         c * m->opt.timestep * damper_inverse_mass(m, damper.source) > kWeak;
}

void find_dampers(const mjModel* m, std::vector<RowDamper>& dampers) {
  static_assert(mjNPOLY == 2);
  for (int tendon = 0; tendon < m->ntendon; ++tendon) {
    const mjtNum* const high_order = m->tendon_dampingpoly + mjNPOLY * tendon;
    const RowDamper damper{-1 - tendon, {m->tendon_damping[tendon], high_order[0], high_order[1]}};
    if (is_strong(m, damper) && m->tendon_treenum[tendon] <= kMostTrees &&
        !(takes_derivatives(m) && is_derived(m, tendon)))
      dampers.push_back(damper);
  }
  for (int flex = 0; flex < m->nflex; ++flex) {
    if (m->flex_edgedamping[flex] == 0.0 || m->flex_rigid[flex] || m->flex_interp[flex]) continue;
    const int first = m->flex_edgeadr[flex], last = first + m->flex_edgenum[flex];
    const auto damper = [&](int edge) {
      return RowDamper{source_of_edge(m, edge), {m->flex_edgedamping[flex], 0.0, 0.0}};
    };
    bool any = false;
    for (int edge = first; edge < last && !any; ++edge)
      any = !m->flexedge_rigid[edge] && is_strong(m, damper(edge));
    for (int edge = first; any && edge < last; ++edge)
      if (!m->flexedge_rigid[edge]) dampers.push_back(damper(edge));
  }
}

// Writes the coefficients of a damper times `scale`.
void write(mjModel* m, const RowDamper& damper, double scale) {
  const auto& [c, linear, square] = damper.coefficient;
  if (is_tendon(m, damper.source)) {
    const int tendon = tendon_of(damper.source);
    m->tendon_damping[tendon] = scale * c;
    m->tendon_dampingpoly[mjNPOLY * tendon] = scale * linear;
    m->tendon_dampingpoly[mjNPOLY * tendon + 1] = scale * square;
    return;
  }
  int flex = static_cast<int>(m->nflex) - 1;
  while (m->flex_edgeadr[flex] > edge_of(m, damper.source)) --flex;
  m->flex_edgedamping[flex] = scale * c;
}

// Reciprocal condition of M + h D from which on MuJoCo's own solution is rounding.
constexpr double kSingularDerivatives = 1e-14;

}  // namespace

void find_joint_springs(const mjModel_* m, Trees& trees) {
  for (Tree& t : trees.tree) {
    t.sprung = false;
    for (int i = 0; i < t.dof_count && !t.free_body; ++i)
      trees.stiffness[t.begin + i] = stiffness_of(m, t.dof_begin + i);
  }
}

double joint_spring_force(const mjModel_* m, const mjData_* d, int dof) {
  if (is_discrete(m)) return d->qfrc_spring[dof];
  const double stiffness = stiffness_of(m, dof);
  if (stiffness == 0.0) return 0.0;
  const int place = m->jnt_qposadr[m->dof_jntid[dof]];
  return stiffness * (m->qpos_spring[place] - d->qpos[place]);
}

DampersInRows::DampersInRows(mjModel_* m, bool any, std::vector<RowDamper>& dampers)
    : model_(m), dampers_(dampers) {
  dampers_.clear();
  if (any && !(m->opt.disableflags & mjDSBL_DAMPER)) find_dampers(m, dampers_);
  for (const RowDamper& damper : dampers_) write(model_, damper, 0.0);
}

DampersInRows::~DampersInRows() {
  for (const RowDamper& damper : dampers_) write(model_, damper, 1.0);
}

void append_dampers(const mjModel_* m, const mjData_* d, const std::vector<RowDamper>& dampers,
                    std::vector<ConstraintInput>& constraints) {
  for (const RowDamper& damper : dampers) {
    ConstraintInput input;
    input.kind = RowKind::kSlider;
    input.source = damper.source;
    input.memory = -1;
    input.limit = std::numeric_limits<double>::infinity();
    input.tree = trees_of_row(m, d, damper.source);
    if (input.tree[0] < 0 || sleeps(d, input.tree[0])) continue;
    double rate = 0.0;
    const SparseRow row = damper_row(m, d, damper.source);
    for (int k = 0; k < row.count; ++k) rate += row.value[k] * d->qvel[row.dof[k]];
    const auto& [c, linear, square] = damper.coefficient;
    input.damping = c + std::abs(rate) * (linear + std::abs(rate) * square);
    constraints.push_back(input);
  }
}

SparseRow damper_row(const mjModel_* m, const mjData_* d, int source) {
  if (is_tendon(m, source)) {
    const int tendon = tendon_of(source), first = m->ten_J_rowadr[tendon];
    return {m->ten_J_colind + first, d->ten_J + first, m->ten_J_rownnz[tendon]};
  }
  const int edge = edge_of(m, source), first = m->flexedge_J_rowadr[edge];
  return {m->flexedge_J_colind + first, d->flexedge_J + first, m->flexedge_J_rownnz[edge]};
}

double damper_inverse_mass(const mjModel_* m, int source) {
  return is_tendon(m, source) ? m->tendon_invweight0[tendon_of(source)]
                              : m->flexedge_invweight0[edge_of(m, source)];
}

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
