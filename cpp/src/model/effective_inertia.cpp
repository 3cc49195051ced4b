#include "dashpot/model/effective_inertia.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/errors.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/sleep.hpp"
#include "dashpot/model/springs_and_dampers.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"
#include "discrete.hpp"

// Exported by the pinned MuJoCo library though not declared in its public headers: derivatives of
// the smooth forces with respect to velocity, which mj_implicit itself starts from.
extern "C" {
void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);
void mjd_actuator_vel(const mjModel* m, mjData* d);
}

namespace dashpot::host {

namespace {

// Fraction of H that D stays implicit for in micro-steps. In flight half of the longest of these:
// dampers are followed to second order then, and any of them is stable. Of what rows hold it is
// more: with less, what drives gain within a step (trapezoid.hpp) throws about light links that
// dampers hold; with more, what strong dampers hold follows late.
constexpr double kImplicitPart = 1.0 / 26.0, kImplicitPartOfHeld = 0.25;
// Fraction of a velocity that explicit damping takes in a step. Followed to second order, as Adams
// and Bashforth do, it is stable up to 1, held over the step up to 2.
constexpr double kStrongDamping = 0.5;
constexpr int kTreesAtOnce = 32;  // by a thread

// Whether the effective inertia of a tree is that of a rigid body alone: a free body without
// armature, and without forces that the integrator treats implicitly.
bool has_rigid_body_inertia(const mjModel* m, const mjData* d, const Trees& trees, int tree) {
  if (!is_free_body(m, tree)) return false;
  const int begin = m->tree_dofadr[tree];
  for (int dof = begin; dof < begin + m->tree_dofnum[tree]; ++dof) {
    if (m->dof_armature[dof] != 0.0) return false;
    if (trees.joint_damping[dof] != 0.0) return false;
    if (takes_derivatives(m))
      for (int k = m->D_rowadr[dof]; k < m->D_rowadr[dof] + m->D_rownnz[dof]; ++k)
        if (d->qDeriv[k] != 0.0) return false;
  }
  if (!trees.implicit_of(tree).empty()) return false;
  for (int tendon = 0; tendon < m->ntendon; ++tendon) {
    if (m->tendon_armature[tendon] == 0.0) continue;
    const int *first = m->ten_J_colind + m->ten_J_rowadr[tendon],
              *last = first + m->ten_J_rownnz[tendon];
    if (std::any_of(first, last, [&](int dof) { return m->dof_treeid[dof] == tree; })) return false;
  }
  return true;
}

// In the form of Trees::inverse for free bodies.
void invert_body_inertia(const mjModel* m, const mjData* d, int tree, const WeldedParts* parts,
                         double* inverse) {
  const int body = m->dof_bodyid[m->tree_dofadr[tree]];
  mjtNum of_parts[9];
  const mjtNum* rotation = d->ximat + 9 * body;
  const mjtNum* moments = m->body_inertia + 3 * body;
  if (parts) {
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{of_parts} =
        (orientation(m, d, tree) * parts->principal()).normalized().matrix();
    rotation = of_parts;
    moments = parts->moments().data();
  }
  const double mass = parts ? parts->mass() : m->body_mass[body];
  for (int i = 0; i < 3; ++i) inverse[i] = 1.0 / mass;
  inverse[3] = 0.0;
  for (int j = 0; j < 3; ++j) {
    double* column = inverse + 4 * (j + 1);
    for (int i = 0; i < 3; ++i) {
      column[i] = 0.0;
      for (int axis = 0; axis < 3; ++axis)
        column[i] += rotation[3 * i + axis] * rotation[3 * j + axis] / moments[axis];
    }
    column[3] = 0.0;
  }
}

// Factor of M + h D, in the rows of factor_inertia; false where it is not positive definite. Of a
// sparse tree, without what springs couple.
bool factor_tree(const mjModel* m, const mjData* d, const Trees& trees, int tree, double h,
                 double* factor) {
  const Tree& t = trees.tree[tree];
  const bool derived = takes_derivatives(m);
  std::fill_n(factor, trees.end_of_factor(tree) - t.inverse, 0.0);
  const auto row_of = [&](int dof) { return factor + trees.row_begin[dof] - t.dof_begin; };
  for (int dof = t.dof_begin; dof < t.dof_begin + t.dof_count; ++dof) {
    double* row = row_of(dof);
    for (int k = m->M_rowadr[dof]; k < m->M_rowadr[dof] + m->M_rownnz[dof]; ++k) {
      double& entry = row[m->M_colind[k]];
      entry = d->M[k];
      if (derived) entry -= h * d->qDeriv[m->mapD2M[k]];
    }
    if (!derived) row[dof] += h * trees.joint_damping[dof];
  }
  if (!t.sparse)
    for (const ImplicitEntry& entry : trees.implicit_of(tree))
      row_of(entry.row)[entry.column] += h * (entry.damping + m->opt.timestep * entry.stiffness);
  return factor_inertia(trees, tree, factor);
}

void require(bool is_definite, const mjModel* m, const Tree& tree) {
  if (is_definite) return;
  throw DivergenceError("the inertia of the tree of joint " +
                        named(m, mjOBJ_JOINT, m->dof_jntid[tree.dof_begin]) +
                        " is singular or not finite; give its bodies mass, or joints armature");
}

// Fills in D of a tree.
void find_damping(const mjModel* m, const mjData* d, Tree& t, Trees& trees) {
  double* diagonal = trees.damping.data() + t.begin;
  double* beside = trees.cross_damping.data() + t.inverse;
  if (t.cross_damped) std::fill_n(beside, t.count * t.count, 0.0);
  t.damped = t.cross_damped = false;
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    diagonal[i] = damping_of(m, d, trees, dof);
    t.damped = t.damped || diagonal[i] != 0.0;
    // What bodies of a sparse tree have beside it stays in H alone.
    if (!takes_derivatives(m) || t.sparse) continue;
    // The diagonal is the last of a row.
    for (int k = m->M_rowadr[dof]; k < m->M_rowadr[dof] + m->M_rownnz[dof] - 1; ++k) {
      const int j = m->M_colind[k] - t.dof_begin;
      const double entry = -d->qDeriv[m->mapD2M[k]];
      if (entry == 0.0) continue;
      beside[i * t.count + j] = beside[j * t.count + i] = entry;
      t.damped = t.cross_damped = true;
    }
  }
}

// u' D v of a tree with D = -qDeriv, whose lower triangle M's sparsity maps.
double derivative_form(const mjModel* m, const mjData* d, const Tree& t, const double* u,
                       const double* v) {
  double sum = 0.0;
  for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
    for (int k = m->M_rowadr[i]; k < m->M_rowadr[i] + m->M_rownnz[i]; ++k) {
      const int j = m->M_colind[k];
      const double product = i == j ? u[i] * v[i] : u[i] * v[j] + u[j] * v[i];
      sum -= d->qDeriv[m->mapD2M[k]] * product;
    }
  return sum;
}

// Derivative of a damping force (c + c_1 |v| + c_2 v^2) v at v = `velocity`.
double damping_derivative(double damping, const double* high_order, double velocity) {
  double slope = damping, power = 1.0;
  for (int i = 0; i < mjNPOLY; ++i) {
    power *= std::abs(velocity);
    slope += (i + 2) * high_order[i] * power;
  }
  return slope;
}

// Derivative of a joint's damping at `velocity` and of its actuator's, N s/m or N m s/rad.
double joint_damping(const mjModel_* m, int dof, double velocity) {
  double damping =
      damping_derivative(m->dof_damping[dof], m->dof_dampingpoly + mjNPOLY * dof, velocity);
  const int actuator = m->jnt_actuatorid[m->dof_jntid[dof]];
  if (actuator < 0) return damping;
  const double gear = m->actuator_gear[6 * m->actuator_outadr[actuator]];
  return damping + gear * gear *
                       damping_derivative(m->actuator_damping[actuator],
                                          m->actuator_dampingpoly + mjNPOLY * actuator, velocity);
}

// The weight of joint damping in D where that does not come from derivatives.
double joint_damping_weight(const mjModel_* m) {
  if (takes_derivatives(m) || is_discrete(m) || (m->opt.disableflags & mjDSBL_DAMPER)) return 0.0;
  if (is_runge_kutta(m)) return 1.0;
  return m->opt.disableflags & mjDSBL_EULERDAMP ? 0.0 : 1.0;
}

// The most that actuators take of a degree of freedom's velocity, of an integrator that treats them
// explicitly: the sum of the sizes of their derivatives in its row, N s/m or N m s/rad.
double actuator_damping(const mjModel_* m, const mjData_* d, int dof) {
  if (takes_derivatives(m) || is_discrete(m) || m->nactuator == 0) return 0.0;
  double sum = 0.0;
  for (int k = m->D_rowadr[dof]; k < m->D_rowadr[dof] + m->D_rownnz[dof]; ++k)
    sum += std::abs(d->qDeriv[k]);
  return sum;
}

// Adds D v (nv) of a D that comes from derivatives.
void add_damping(const mjModel_* m, const mjData_* d, const double* v, double* product) {
  for (int i = 0; i < m->nv; ++i)
    for (int k = m->M_rowadr[i]; k < m->M_rowadr[i] + m->M_rownnz[i]; ++k) {
      const int j = m->M_colind[k];
      const double damping = -d->qDeriv[m->mapD2M[k]];
      product[i] += damping * v[j];
      if (i != j) product[j] += damping * v[i];
    }
}

}  // namespace

bool takes_derivatives(const mjModel_* m) {
  return m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST;
}

double damping_form(const mjModel_* m, const mjData_* d, const Trees& trees, const Tree& t,
                    const double* u, const double* v) {
  if (takes_derivatives(m)) return derivative_form(m, d, t, u, v);
  double sum = 0.0;
  for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
    sum += trees.joint_damping[i] * u[i] * v[i];
  for (const ImplicitEntry& e : trees.implicit_of(static_cast<int>(&t - trees.tree.data()))) {
    const double both = e.row == e.column ? 0.0 : u[e.column] * v[e.row];
    sum += (e.damping + m->opt.timestep * e.stiffness) * (u[e.row] * v[e.column] + both);
  }
  return sum;
}

double damping_of(const mjModel_* m, const mjData_* d, const Trees& trees, int dof) {
  if (takes_derivatives(m)) return -d->qDeriv[m->mapD2M[m->M_rowadr[dof] + m->M_rownnz[dof] - 1]];
  return trees.joint_damping[dof];
}

void add_strong_damping(const mjModel_* m, const mjData_* d, const double* v, double* product) {
  thread_local std::vector<double> force;  // kept by the thread: a step allocates nothing
  force.clear();
  for (int i = 0; i < m->nv; ++i) {
    if (m->opt.timestep * actuator_damping(m, d, i) * m->dof_invweight0[i] <= kStrongDamping)
      continue;
    if (force.empty()) {
      force.assign(m->nv, 0.0);
      add_damping(m, d, v, force.data());
    }
    product[i] += force[i];
  }
}

void prepare_effective_inertia(const mjModel_* m, mjData_* d, Trees& trees) {
  if (is_discrete(m)) return take_metric(m, d, trees);
  trees.implicit.clear();
  if (takes_derivatives(m)) return mjd_smooth_vel(m, d, 0);
  if (m->nactuator == 0) return;
  mju_zero(d->qDeriv, m->nD);
  mjd_actuator_vel(m, d);
}

void find_effective_inertia(const mjModel_* m, mjData_* d, const std::vector<WeldedParts>& parts,
                            Trees& trees, Team& team) {
  const double weight = joint_damping_weight(m);
  for (int i = 0; i < m->nv; ++i)
    trees.joint_damping[i] = weight > 0.0 ? weight * joint_damping(m, i, d->qvel[i]) : 0.0;
  team.for_each(static_cast<int>(trees.tree.size()), kTreesAtOnce, [&](int index) {
    if (sleeps(d, index)) return;
    Tree& t = trees.tree[index];
    t.free_body = has_rigid_body_inertia(m, d, trees, index);
    t.damped = t.elastic = t.whole = false;
    if (t.free_body) {
      invert_body_inertia(m, d, index, parts_of(m, parts, index), trees.inverse.data() + t.inverse);
      return;
    }
    trees.sparse_is_known[index] = 0;
    double* factor = trees.factor.data() + t.inverse;
    const bool is_definite = factor_tree(m, d, trees, index, m->opt.timestep, factor);
    if (takes_derivatives(m) && (!is_definite || is_free_body(m, index)))
      t.whole = solve_whole(m, d, t, trees.whole_acceleration.data() + t.begin);
    if (is_definite) return;
    if (takes_derivatives(m)) keep_what_damps(m, d, index);
    require(factor_tree(m, d, trees, index, m->opt.timestep, factor), m, t);
  });
}

void find_coupled_inertia(const mjModel_* m, const mjData_* d, int tree, Trees& trees) {
  if (trees.sparse_is_known[tree]) return;
  trees.sparse_is_known[tree] = 1;
  const Tree& t = trees.tree[tree];
  if (!trees.is_soft(tree)) return trees.sparse[tree].reset();
  const double h = t.elastic ? t.implicit_time : m->opt.timestep;
  require(factor_coupled(m, d, trees, tree, h), m, t);
}

void damp_in_microsteps(const mjModel_* m, const mjData_* d, int tree, bool is_held, Trees& trees) {
  Tree& t = trees.tree[tree];
  if (t.free_body || is_free_body(m, tree)) return;
  if (is_discrete(m))
    t.elastic = t.damped = t.sprung = !trees.implicit_of(tree).empty();
  else
    find_damping(m, d, t, trees);
  const double part = is_held || is_discrete(m) ? kImplicitPartOfHeld : kImplicitPart;
  t.implicit_time = part * m->opt.timestep;
  trees.sparse_is_known[tree] = 0;
  if (t.damped && !(t.sparse && t.elastic))
    require(factor_tree(m, d, trees, tree, t.implicit_time, trees.factor.data() + t.inverse), m, t);
}

void solve_damped(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                  double implicit_time, double* x) {
  const Tree& t = trees.tree[tree];
  thread_local std::vector<double> factor;  // kept by the thread: a step allocates nothing
  factor.resize(trees.end_of_factor(tree) - t.inverse);
  require(factor_tree(m, d, trees, tree, implicit_time, factor.data()), m, t);
  solve_inertia(trees, tree, factor.data(), x);
}

void smooth_acceleration(const mjModel_* m, const mjData_* d, Trees& trees, int tree,
                         double* acceleration) {
  const Tree& t = trees.tree[tree];
  if (t.free_body || (is_discrete(m) && m->opt.timestep == trees.implicit_step)) {
    std::copy_n(d->qacc_smooth + t.dof_begin, t.dof_count, acceleration);
    return;
  }
  if (t.whole) {
    std::copy_n(trees.whole_acceleration.data() + t.begin, t.dof_count, acceleration);
    return;
  }
  std::copy_n(d->qfrc_smooth + t.dof_begin, t.dof_count, acceleration);
  add_stiffness_shift(m, trees, tree, d->qvel, acceleration - t.dof_begin);
  find_coupled_inertia(m, d, tree, trees);
  solve_effective(trees, tree, acceleration);
}

}  // namespace dashpot::host
