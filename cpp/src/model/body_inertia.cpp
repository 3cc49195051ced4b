#include "dashpot/model/body_inertia.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot::host {

namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kTreesAtOnce = 16;  // by a thread

Vector3d vector_of(const mjtNum* values) { return Eigen::Map<const Vector3d>(values); }
Quaterniond quaternion_of(const mjtNum* q) { return {q[0], q[1], q[2], q[3]}; }

bool has_inertia(const mjModel* m, int body) {
  return m->body_mass[body] != 0.0 || !mju_isZero(m->body_inertia + 3 * body, 3);
}

void check_positive(const mjModel* m, const char* what, int root, double value) {
  if (std::isfinite(value) && value > 0.0) return;
  throw std::invalid_argument(std::string(what) + " of " + named(m, mjOBJ_BODY, root) +
                              ", with all that is welded to it, is " + std::to_string(value) +
                              "; it must be finite and > 0");
}

constexpr double kRoundingOfInertia = 1.0e-9;  // relative

// Of the body that a simple degree of freedom moves.
double own_inertia(const mjModel* m, int dof) {
  const int body = m->dof_bodyid[dof], joint = m->dof_jntid[dof];
  const int part = dof - m->jnt_dofadr[joint];
  const mjtNum* moments = m->body_inertia + 3 * body;
  switch (m->jnt_type[joint]) {
    case mjJNT_FREE:
      return part < 3 ? m->body_mass[body] : moments[part - 3];
    case mjJNT_BALL:
      return moments[part];
    case mjJNT_SLIDE:
      return m->body_mass[body];
    default: {
      const mjtNum* axis = m->jnt_axis + 3 * joint;
      return axis[0] * axis[0] * moments[0] + axis[1] * axis[1] * moments[1] +
             axis[2] * axis[2] * moments[2];
    }
  }
}

void check(const mjModel* m, const char* field, int body, double value, bool positive) {
  if (std::isfinite(value) && (positive ? value > 0.0 : value >= 0.0)) return;
  throw std::invalid_argument("model." + std::string(field) + " of " + named(m, mjOBJ_BODY, body) +
                              " holds " + std::to_string(value) + "; it must be finite and " +
                              (positive ? "> 0" : ">= 0"));
}

bool is_rounding(double value, double exact) {
  return std::abs(value - exact) <= kRoundingOfInertia * exact;
}

// Simple, without a joint but a free one: nothing else changes its inertia.
bool is_lone(const mjModel* m, int body) {
  return m->body_simple[body] == 1 && m->body_dofnum[body] == 6;
}

// Whether that of another body than lone ones was edited.
bool follow_in_subtrees(mjModel* m) {
  thread_local std::vector<double> mass;  // kept by the thread: no allocation in a step
  mass.assign(m->body_mass, m->body_mass + m->nbody);
  for (int body = static_cast<int>(m->nbody) - 1; body > 0; --body)
    mass[m->body_parentid[body]] += mass[body];
  bool any = false;
  for (int body = 0; body < m->nbody; ++body) {
    if (is_rounding(m->body_subtreemass[body], mass[body])) continue;
    m->body_subtreemass[body] = mass[body];
    any = any || (body > 0 && !is_lone(m, body));
  }
  return any;
}

// Means of the inverse inertia of its translations, and of its rotations.
void follow_in_lone_body(mjModel* m, int body) {
  for (int kind = 0; kind < 2; ++kind) {
    const int first = m->body_dofadr[body] + 3 * kind;
    double mean = 0.0;
    for (int i = 0; i < 3; ++i) mean += 1.0 / m->dof_M0[first + i] / 3.0;
    m->body_invweight0[2 * body + kind] = mean;
    std::fill_n(m->dof_invweight0 + first, 3, mean);
  }
}

struct ModelDeleter {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
};

// By MuJoCo, in a copy: it changes much beside.
void follow_in_all_bodies(mjModel* m) {
  const ErrorGuard guard;
  const std::unique_ptr<mjModel, ModelDeleter> copy(mj_copyModel(nullptr, m));
  if (!copy) throw MujocoError("MuJoCo could not copy the model");
  const OwnedData data = make_data(copy.get());
  mj_setConst(copy.get(), data.get());
  std::copy_n(copy->body_invweight0, 2 * m->nbody, m->body_invweight0);
  std::copy_n(copy->dof_invweight0, m->nv, m->dof_invweight0);
  std::copy_n(copy->tendon_invweight0, m->ntendon, m->tendon_invweight0);
  std::copy_n(copy->flexedge_invweight0, m->nflexedge, m->flexedge_invweight0);
}

}  // namespace

void WeldedParts::read(const mjModel_* m, int tree) {
  const int root = m->tree_bodyadr[tree], count = m->tree_bodynum[tree];
  part_.resize(count);
  part_[0] = {Vector3d::Zero(), Quaterniond::Identity()};
  int heavy = 0, last_heavy = 0;
  mass_ = 0.0;
  offset_.setZero();
  for (int i = 0; i < count; ++i) {
    const int body = root + i;
    Part& part = part_[i];
    if (i > 0) {
      const Part& parent = part_[m->body_parentid[body] - root];
      part.position = parent.position + parent.orientation * vector_of(m->body_pos + 3 * body);
      part.orientation = (parent.orientation * quaternion_of(m->body_quat + 4 * body)).normalized();
    }
    if (!has_inertia(m, body)) continue;
    ++heavy;
    last_heavy = i;
    mass_ += m->body_mass[body];
    offset_ += m->body_mass[body] *
               (part.position + part.orientation * vector_of(m->body_ipos + 3 * body));
  }
  check_positive(m, "the mass", root, mass_);
  if (heavy == 1) {
    const int body = root + last_heavy;
    const Part& part = part_[last_heavy];
    offset_ = part.position + part.orientation * vector_of(m->body_ipos + 3 * body);
    principal_ = part.orientation * quaternion_of(m->body_iquat + 4 * body);
    moments_ = vector_of(m->body_inertia + 3 * body);
    inertia_.setZero();
  } else {
    offset_ /= mass_;
    Matrix3d inertia = Matrix3d::Zero();
    for (int i = 0; i < count; ++i) {
      const int body = root + i;
      if (!has_inertia(m, body)) continue;
      const Part& part = part_[i];
      const Matrix3d axes =
          (part.orientation * quaternion_of(m->body_iquat + 4 * body)).normalized().matrix();
      const Vector3d arm =
          part.position + part.orientation * vector_of(m->body_ipos + 3 * body) - offset_;
      inertia +=
          axes * vector_of(m->body_inertia + 3 * body).asDiagonal() * axes.transpose() +
          m->body_mass[body] * (arm.squaredNorm() * Matrix3d::Identity() - arm * arm.transpose());
    }
    if (inertia != inertia_) {
      inertia_ = inertia;
      find_principal_axes();
    }
  }
  check_positive(m, "the least moment of inertia", root, moments_.minCoeff());
}

// Those of the frame stay, where they are principal ones.
void WeldedParts::find_principal_axes() {
  if (inertia_.isDiagonal(0.0)) {
    principal_.setIdentity();
    moments_ = inertia_.diagonal();
    return;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(inertia_);
  Matrix3d axes = solver.eigenvectors();
  if (axes.determinant() < 0.0) axes.col(2) *= -1.0;
  principal_ = Quaterniond(axes).normalized();
  moments_ = solver.eigenvalues();
}

bool has_welded_parts(const mjModel_* m, int tree) {
  return m->tree_bodynum[tree] > 1 && is_free_body(m, tree);
}

void read_welded_parts(const mjModel_* m, int trees, std::vector<WeldedParts>& parts, Team& team) {
  if (parts.empty()) {
    int tree = 0;
    while (tree < trees && !has_welded_parts(m, tree)) ++tree;
    if (tree == trees) return;
    parts.resize(trees);
  }
  team.for_each(trees, kTreesAtOnce, [&](int tree) {
    if (has_welded_parts(m, tree)) parts[tree].read(m, tree);
  });
}

const WeldedParts* parts_of(const mjModel_* m, const std::vector<WeldedParts>& parts, int tree) {
  return has_welded_parts(m, tree) ? &parts[tree] : nullptr;
}

const double* centre_of_motion(const mjModel_* m, const mjData_* d, int body) {
  const int tree = m->body_treeid[body];
  if (tree >= 0 && has_welded_parts(m, tree)) return d->subtree_com + 3 * m->body_rootid[body];
  return d->xipos + 3 * body;
}

void check_masses(const mjModel_* m) {
  const bool none_negative = are_finite_and_not_negative(m->body_mass, m->nbody) &&
                             are_finite_and_not_negative(m->body_inertia, 3 * m->nbody);
  for (int body = 0; body < m->nbody; ++body) {
    const int dofs = m->body_dofnum[body];
    const bool simple = dofs > 0 && m->dof_simplenum[m->body_dofadr[body]] > 0;
    if (none_negative && !simple) continue;
    check(m, "body_mass", body, m->body_mass[body], simple);
    const bool turns = simple && m->body_simple[body] == 1;
    for (int axis = 0; axis < 3; ++axis)
      check(m, "body_inertia", body, m->body_inertia[3 * body + axis], turns);
  }
}

void follow_edited_masses(mjModel_* m) {
  bool any = follow_in_subtrees(m);
  for (int dof = 0; dof < m->nv; ++dof) {
    if (m->dof_simplenum[dof] == 0) continue;
    const double inertia = own_inertia(m, dof) + m->dof_armature[dof];
    if (is_rounding(m->dof_M0[dof], inertia)) continue;
    m->dof_M0[dof] = inertia;
    const int body = m->dof_bodyid[dof];
    if (is_lone(m, body))
      follow_in_lone_body(m, body);
    else
      any = true;
  }
  if (any) follow_in_all_bodies(m);
}

}  // namespace dashpot::host
