#include "dashpot/mujoco/welded_parts.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/mujoco/names.hpp"
#include "dashpot/mujoco/trees.hpp"

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

}  // namespace dashpot::host
