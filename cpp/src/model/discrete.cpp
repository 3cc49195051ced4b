#include "discrete.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>

#include "dashpot/model/errors.hpp"

// Exported by MuJoCo's library though not declared in its public headers: the metric of
// `discrete`, which flexes it has as a sparse matrix, and products of a vector with the stiffness
// and the damping of all flexes.
extern "C" {
#if mjVERSION_HEADER < 3016000
#define mj_effBuild mjd_effBuild  // its name before
#endif
void mj_effBuild(const mjModel* m, mjData* d, int active, int flg_factor);
int mj_flexSimple(const mjModel* m, int flex);
mjtBool mjd_flexInterpAssemblable(const mjModel* m);
void mjd_flexBend_mul(const mjModel* m, mjData* d, mjtNum* product, const mjtNum* vector,
                      mjtNum stiffness, mjtNum damping);
void mjd_flexStretch_mul(const mjModel* m, mjData* d, mjtNum* product, const mjtNum* vector,
                         mjtNum stiffness, mjtNum damping);
void mjd_flexInterp_mul(const mjModel* m, mjData* d, mjtNum* product, const mjtNum* vector,
                        mjtNum stiffness, mjtNum damping, const mjtNum* rotated);
}

namespace dashpot::host {

namespace {

// Whether MuJoCo has a flex's stiffness as a product alone, as where it hangs on turning bodies.
bool is_matrix_free(const mjModel* m, const mjData* d, int flex) {
  if (m->flex_rigid[flex] || m->flex_dim[flex] < 2) return false;
  if (m->flex_interp[flex]) return d->nefmK == 0 || !mjd_flexInterpAssemblable(m);
  return d->nefmK == 0 || !mj_flexSimple(m, flex);
}

// Collects entries of a metric that is h D + h^2 K.
class Collector {
 public:
  Collector(const mjModel* m, mjData* d, std::vector<ImplicitEntry>& entries)
      : m_(m), d_(d), h_(m->opt.timestep), entries_(entries) {}

  // scale * J'J, of which h K has `shift` * J'J.
  void add_row(const int* column, const mjtNum* value, int count, double scale, double shift) {
    const double stiffness = shift / h_, damping = scale / h_ - shift;
    for (int i = 0; i < count; ++i)
      for (int j = 0; j < count; ++j)
        if (column[j] <= column[i])
          add(column[i], column[j], value[i] * value[j] * stiffness, value[i] * value[j] * damping);
  }

  void add_diagonal() {
    for (int i = 0; i < m_->nv && d_->efm_diag; ++i)
      add(i, i, d_->efm_ck[i] / h_, d_->efm_diag[i] / h_ - d_->efm_ck[i]);
  }

  void add_fluid() {
    for (int i = 0; i < m_->nv && d_->efm_fluid; ++i)
      for (int k = m_->M_rowadr[i]; k < m_->M_rowadr[i] + m_->M_rownnz[i]; ++k)
        add(i, m_->M_colind[k], 0.0, d_->efm_fluid[k] / h_);
  }

  void add_tendons() {
    for (int i = 0; i < d_->nefmT; ++i) {
      const int tendon = d_->efm_tid[i], begin = m_->ten_J_rowadr[tendon];
      add_row(m_->ten_J_colind + begin, d_->ten_J + begin, m_->ten_J_rownnz[tendon], d_->efm_ts[i],
              d_->efm_tk[i]);
    }
  }

  void add_actuators() {
    for (int i = 0; i < d_->nefmA; ++i) {
      const int first = m_->actuator_outadr[d_->efm_aid[i]];
      for (int k = first; k < first + m_->actuator_outnum[d_->efm_aid[i]]; ++k)
        add_row(d_->moment_colind + d_->moment_rowadr[k],
                d_->actuator_moment + d_->moment_rowadr[k], d_->moment_rownnz[k], d_->efm_as[i],
                d_->efm_ak[i]);
    }
  }

  // The trees of those whose stiffness is no matrix, column by column.
  void probe_flexes() {
    probed_.assign(m_->ntree, 0);
    for (int flex = 0; flex < m_->nflex; ++flex) {
      if (!is_matrix_free(m_, d_, flex)) continue;
      const auto mark = [&](const int* body, int count) {
        for (int i = 0; i < count; ++i)
          if (body[i] >= 0 && m_->body_treeid[body[i]] >= 0) probed_[m_->body_treeid[body[i]]] = 1;
      };
      mark(m_->flex_vertbodyid + m_->flex_vertadr[flex], m_->flex_vertnum[flex]);
      mark(m_->flex_nodebodyid + m_->flex_nodeadr[flex], m_->flex_nodenum[flex]);
    }
    if (std::find(probed_.begin(), probed_.end(), 1) == probed_.end()) return;
    std::vector<mjtNum> unit(m_->nv, 0.0), stiffness(m_->nv), damping(m_->nv);
    const bool springs = !(m_->opt.disableflags & mjDSBL_SPRING);
    const bool dampers = !(m_->opt.disableflags & mjDSBL_DAMPER);
    for (int j = 0; j < m_->nv; ++j) {
      if (!is_probed(j)) continue;
      unit[j] = 1.0;
      multiply(unit, springs, 0.0, stiffness);
      multiply(unit, 0.0, dampers, damping);
      unit[j] = 0.0;
      for (int i = j; i < m_->nv; ++i) add(i, j, stiffness[i], damping[i]);
    }
  }

  // K of all other flexes, of which their damping is a multiple.
  void add_flexes() {
    if (d_->nefmK == 0) return;
    std::vector<double> stiff(m_->nbody, 1.0);  // part of h^2 K
    for (int flex = 0; flex < m_->nflex; ++flex) {
      const double spring = m_->opt.disableflags & mjDSBL_SPRING ? 0.0 : h_;
      const double damper = m_->opt.disableflags & mjDSBL_DAMPER ? 0.0 : m_->flex_damping[flex];
      const double part = spring + damper > 0.0 ? spring / (spring + damper) : 0.0;
      const auto set = [&](const int* body, int count) {
        for (int i = 0; i < count; ++i)
          if (body[i] >= 0) stiff[body[i]] = part;
      };
      set(m_->flex_vertbodyid + m_->flex_vertadr[flex], m_->flex_vertnum[flex]);
      set(m_->flex_nodebodyid + m_->flex_nodeadr[flex], m_->flex_nodenum[flex]);
    }
    for (int i = 0; i < m_->nv; ++i) {
      if (is_probed(i)) continue;
      const double part = stiff[m_->dof_bodyid[i]];
      const int begin = d_->efm_K_rowadr[i];
      for (int k = begin; k < begin + d_->efm_K_rownnz[i]; ++k)
        if (d_->efm_K_colind[k] <= i)
          entries_.push_back({i, d_->efm_K_colind[k], part * d_->efm_K_val[k] / (h_ * h_),
                              (1.0 - part) * d_->efm_K_val[k] / h_});
    }
  }

 private:
  bool is_probed(int dof) const { return probed_[m_->dof_treeid[dof]]; }

  void multiply(const std::vector<mjtNum>& vector, double stiffness, double damping,
                std::vector<mjtNum>& product) {
    std::fill(product.begin(), product.end(), 0.0);
    mjd_flexBend_mul(m_, d_, product.data(), vector.data(), stiffness, damping);
    mjd_flexStretch_mul(m_, d_, product.data(), vector.data(), stiffness, damping);
    mjd_flexInterp_mul(m_, d_, product.data(), vector.data(), -stiffness, -damping,
                       d_->flexelem_krot);
  }

  void add(int row, int column, double stiffness, double damping) {
    if (stiffness != 0.0 || damping != 0.0) entries_.push_back({row, column, stiffness, damping});
  }

  const mjModel* m_;
  mjData* d_;
  double h_;
  std::vector<ImplicitEntry>& entries_;
  std::vector<char> probed_;  // by tree
};

bool is_above(const Trees& trees, int tree, int above, int below) {
  const int first = trees.tree[tree].dof_begin;
  const int *begin = trees.path.data() + trees.path_begin[below],
            *end = trees.path.data() + trees.path_begin[below + 1];
  return above == below || std::find(begin, end, above - first) != end;
}

}  // namespace

bool is_discrete(const mjModel_* m) { return m->opt.integrator == mjINT_DISCRETE; }

void build_metric(const mjModel_* m, mjData_* d) {
  // Rows of the step before lie where it goes.
  d->parena = d->ncon * sizeof(mjContact);
  mj_effBuild(m, d, 1, 1);
}

void accelerate_in_metric(const mjModel_* m, mjData_* d) {
  call_with_callbacks(
      [](const mjModel* model, mjData* data) { mj_forwardSkip(model, data, mjSTAGE_VEL, 1); }, m,
      d);
}

void take_metric(const mjModel_* m, mjData_* d, Trees& trees) {
  if (!d->efm_active) return;
  trees.implicit_step = m->opt.timestep;
  trees.implicit.clear();
  trees.implicit_begin.assign(trees.tree.size() + 1, 0);
  Collector collector(m, d, trees.implicit);
  collector.add_diagonal();
  collector.add_fluid();
  collector.add_tendons();
  collector.add_actuators();
  collector.probe_flexes();
  collector.add_flexes();
  // Detection takes the memory that it lies in.
  d->efm_active = 0;
  const auto tree_of = [&](const ImplicitEntry& entry) { return m->dof_treeid[entry.row]; };
  for (const ImplicitEntry& entry : trees.implicit)
    if (m->dof_treeid[entry.column] != tree_of(entry) ||
        (!trees.tree[tree_of(entry)].sparse &&
         !is_above(trees, tree_of(entry), entry.column, entry.row)))
      throw std::invalid_argument(
          "model.opt.integrator became discrete after the engine was made; make one of this model, "
          "whose tendons, actuators or flexes couple branches");
  std::stable_sort(
      trees.implicit.begin(), trees.implicit.end(),
      [&](const ImplicitEntry& a, const ImplicitEntry& b) { return tree_of(a) < tree_of(b); });
  for (const ImplicitEntry& entry : trees.implicit) ++trees.implicit_begin[tree_of(entry) + 1];
  for (size_t i = 0; i < trees.tree.size(); ++i)
    trees.implicit_begin[i + 1] += trees.implicit_begin[i];
}

bool factor_coupled(const mjModel_* m, const mjData_* d, Trees& trees, int tree, double h) {
  const Tree& t = trees.tree[tree];
  const int begin = t.dof_begin;
  thread_local std::vector<SparseInertia::Entry> entries;  // a step allocates nothing
  entries.clear();
  for (int dof = begin; dof < begin + t.dof_count; ++dof)
    for (int k = m->M_rowadr[dof]; k < m->M_rowadr[dof] + m->M_rownnz[dof]; ++k)
      entries.push_back({dof - begin, m->M_colind[k] - begin, d->M[k]});
  for (const ImplicitEntry& e : trees.implicit_of(tree))
    entries.push_back(
        {e.row - begin, e.column - begin, h * (e.damping + m->opt.timestep * e.stiffness)});
  if (!trees.sparse[tree]) trees.sparse[tree] = std::make_shared<SparseInertia>();
  return trees.sparse[tree]->factor(t.dof_count, entries);
}

void add_stiffness_shift(const mjModel_* m, const Trees& trees, int tree, const double* v,
                         double* force) {
  const int begin = trees.tree[tree].dof_begin;
  add_implicit(trees, tree, 0.0, -m->opt.timestep, v + begin, force + begin);
}

}  // namespace dashpot::host
