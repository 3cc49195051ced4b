#include "dashpot/model/elastic_forces.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/trees.hpp"
#include "discrete.hpp"

namespace dashpot::host {

namespace {

using Vector3 = Eigen::Map<const Eigen::Vector3d>;
using Matrix3 = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>;

bool has_stiffness(double stiffness, const mjtNum* high_order) {
  return stiffness != 0.0 || !mju_isZero(high_order, mjNPOLY);
}

// Force along a tendon, N.
double spring_force(const mjModel* m, const mjData* d, int tendon) {
  const mjtNum length = d->ten_length[tendon], *range = m->tendon_lengthspring + 2 * tendon;
  const mjtNum stretch = length - std::clamp<mjtNum>(length, range[0], range[1]);
  mjtNum force = -m->tendon_stiffness[tendon] * stretch, power = stretch;
  for (int i = 0; i < mjNPOLY; ++i) {
    power *= stretch;
    force -= m->tendon_stiffnesspoly[mjNPOLY * tendon + i] * power;
  }
  return force;
}

bool has_spring(const mjModel* m, int joint) {
  return m->jnt_type[joint] == mjJNT_FREE &&
         has_stiffness(m->jnt_stiffness[joint], m->jnt_stiffnesspoly + mjNPOLY * joint);
}

// Adds the force of a free joint's spring that is stretched along `stretch` (3), or its torque.
void add_spring(const mjModel* m, int joint, const mjtNum* stretch, double* force) {
  const mjtNum length = mju_norm3(stretch);
  mjtNum secant = m->jnt_stiffness[joint], power = 1.0;
  for (int i = 0; i < mjNPOLY; ++i) {
    power *= length;
    secant += m->jnt_stiffnesspoly[mjNPOLY * joint + i] * power;
  }
  for (int k = 0; k < 3; ++k) force[k] -= secant * stretch[k];
}

void add_tendon(const mjModel* m, const mjData* d, int tendon, double scale,
                std::vector<double>& force) {
  const int first = m->ten_J_rowadr[tendon], last = first + m->ten_J_rownnz[tendon];
  for (int k = first; k < last; ++k) force[m->ten_J_colind[k]] += scale * d->ten_J[k];
}

void add_actuator(const mjModel* m, const mjData* d, int actuator, double scale,
                  std::vector<double>& force) {
  const int output = m->actuator_outadr[actuator], first = d->moment_rowadr[output];
  for (int k = first; k < first + d->moment_rownnz[output]; ++k)
    force[d->moment_colind[k]] += scale * d->actuator_moment[k];
}

// Whether the weight of some part of a body of several is compensated.
bool is_compensated(const mjModel* m, int tree) {
  if (m->ngravcomp == 0 || (m->opt.disableflags & mjDSBL_GRAVITY)) return false;
  const mjtNum* first = m->body_gravcomp + m->tree_bodyadr[tree];
  return has_welded_parts(m, tree) &&
         std::any_of(first, first + m->tree_bodynum[tree], [](mjtNum c) { return c != 0.0; });
}

// About the centre of mass, world, N m.
Eigen::Vector3d torque_of_compensation(const mjModel* m, const mjData* d, int tree) {
  const int root = m->tree_bodyadr[tree];
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  for (int body = root; body < root + m->tree_bodynum[tree]; ++body)
    moment += m->body_gravcomp[body] * m->body_mass[body] *
              (Vector3(d->xipos + 3 * body) - Vector3(centre_of_motion(m, d, root)));
  return -moment.cross(Vector3(m->opt.gravity));
}

// The wrench (world) at the centre of mass of a generalized force.
Vector6 wrench_at_centre(const mjModel* m, const mjData* d, int tree, const double* force) {
  const int root = m->tree_bodyadr[tree];
  const Vector3 linear(force), angular(force + 3), origin(d->xpos + 3 * root);
  const Eigen::Vector3d arm = Vector3(centre_of_motion(m, d, root)) - origin;
  Vector6 wrench;
  wrench.head<3>() = linear;
  wrench.tail<3>() = Matrix3(d->xmat + 9 * root) * angular - arm.cross(linear);
  if (is_compensated(m, tree)) wrench.tail<3>() += torque_of_compensation(m, d, tree);
  return wrench;
}

// How MuJoCo 3.17 packs what an element and an edge have: the upper triangle of a symmetric matrix
// over the element's edges; one over the four vertices about an edge, and the stiffness that its
// curvature at rest gives their volume.
constexpr int kOfTriangle = 21, kOfTetrahedron = 24, kOfEdge = 17, kCurvature = 16;

const mjtNum* vertex(const mjModel* m, const mjData* d, int flex, int index) {
  return d->flexvert_xpos + 3 * (m->flex_vertadr[flex] + index);
}

// A quarter of the products of what squares of lengths differ by from those at rest.
double stretch_energy(const mjModel* m, const mjData* d, int flex) {
  const bool is_solid = m->flex_dim[flex] == 3;
  const int edges = is_solid ? 6 : 3;
  double energy = 0.0;
  for (int element = 0; element < m->flex_elemnum[flex]; ++element) {
    const int* edge = m->flex_elemedge + m->flex_elemedgeadr[flex] + edges * element;
    std::array<double, 6> change{};
    for (int i = 0; i < edges; ++i) {
      const int at = m->flex_edgeadr[flex] + edge[i];
      const double length = mju_dist3(vertex(m, d, flex, m->flex_edge[2 * at]),
                                      vertex(m, d, flex, m->flex_edge[2 * at + 1]));
      change[i] = length * length - m->flexedge_length0[at] * m->flexedge_length0[at];
    }
    const mjtNum* stiffness = m->flex_stiffness + m->flex_stiffnessadr[flex] +
                              (is_solid ? kOfTetrahedron : kOfTriangle) * element;
    for (int i = 0; i < edges; ++i)
      for (int j = i; j < edges; ++j)
        energy += (i == j ? 0.25 : 0.5) * *stiffness++ * change[i] * change[j];
  }
  return energy;
}

double bending_energy(const mjModel* m, const mjData* d, int flex) {
  double energy = 0.0;
  for (int edge = 0; edge < m->flex_edgenum[flex]; ++edge) {
    const int at = m->flex_edgeadr[flex] + edge;
    const int* flap = m->flex_edgeflap + 2 * at;
    if (flap[1] < 0) continue;  // on the rim
    const std::array<const mjtNum*, 4> x = {
        vertex(m, d, flex, m->flex_edge[2 * at]), vertex(m, d, flex, m->flex_edge[2 * at + 1]),
        vertex(m, d, flex, flap[0]), vertex(m, d, flex, flap[1])};
    const mjtNum* stiffness = m->flex_bending + m->flex_bendingadr[flex] + kOfEdge * edge;
    mjtNum side[3][3], across[3];
    for (int i = 0; i < 3; ++i) mju_sub3(side[i], x[i + 1], x[0]);
    // Rows of the matrix add up to zero: positions count from the first vertex.
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        energy += 0.5 * stiffness[4 * (i + 1) + j + 1] * mju_dot3(side[i], side[j]);
    mju_cross(across, side[1], side[2]);
    energy += stiffness[kCurvature] * mju_dot3(side[0], across);
  }
  return energy;
}

}  // namespace

void ElasticForces::find(const mjModel_* m, const mjData_* d, double length) {
  find_trees(m, d);
  servo_change_.clear();
  if (!any_) return;
  look_ahead(m, d, 0.5 * length);
  for (auto* array : {&now_, &then_, &servo_change_}) array->assign(m->nv, 0.0);
  add_servos(m, d);
  add_tendons(m, d);
  add_joints(m, d);
}

Vector6 ElasticForces::change(const mjModel_* m, const mjData_* d, int tree) const {
  const int dof = m->tree_dofadr[tree];
  return wrench_at_centre(m, ahead_.get(), tree, then_.data() + dof) -
         wrench_at_centre(m, d, tree, now_.data() + dof);
}

void ElasticForces::mark(const mjModel* m, int dof) {
  const int tree = m->dof_treeid[dof];
  if (!is_free_body(m, tree)) return;
  any_ = true;
  acts_[tree] = 1;
}

void ElasticForces::find_trees(const mjModel* m, const mjData* d) {
  any_ = false;
  const int trees = tree_count(m);
  acts_.assign(trees, 0);
  if (is_discrete(m)) return;
  const bool has_springs = !(m->opt.disableflags & mjDSBL_SPRING);
  for (int i = 0; i < m->ntendon && has_springs; ++i) {
    if (!has_stiffness(m->tendon_stiffness[i], m->tendon_stiffnesspoly + mjNPOLY * i)) continue;
    const int first = m->ten_J_rowadr[i], last = first + m->ten_J_rownnz[i];
    for (int k = first; k < last; ++k) mark(m, m->ten_J_colind[k]);
  }
  for (int i = 0; i < m->njnt && has_springs; ++i)
    if (has_spring(m, i)) mark(m, m->jnt_dofadr[i]);
  for (int i = 0; i < m->nactuator && !(m->opt.disableflags & mjDSBL_ACTUATION); ++i) {
    if (servo_stiffness(m, d, i) == 0.0) continue;
    const int output = m->actuator_outadr[i], first = d->moment_rowadr[output];
    for (int k = first; k < first + d->moment_rownnz[output]; ++k) mark(m, d->moment_colind[k]);
  }
  for (int tree = 0; tree < trees && m->ngravcomp > 0; ++tree)
    if (is_compensated(m, tree)) mark(m, m->tree_dofadr[tree]);
}

void ElasticForces::look_ahead(const mjModel* m, const mjData* d, double time) {
  if (!ahead_) ahead_ = make_data(m);
  mjData* ahead = ahead_.get();
  std::copy_n(d->qpos, m->nq, ahead->qpos);
  std::copy_n(d->mocap_pos, 3 * m->nmocap, ahead->mocap_pos);
  std::copy_n(d->mocap_quat, 4 * m->nmocap, ahead->mocap_quat);
  mj_integratePos(m, ahead->qpos, d->qvel, time);
  mj_fwdKinematics(m, ahead);
  if (m->nactuator > 0) mj_transmission(m, ahead);
}

void ElasticForces::add_tendons(const mjModel* m, const mjData* d) {
  if (m->opt.disableflags & mjDSBL_SPRING) return;
  for (int i = 0; i < m->ntendon; ++i) {
    if (!has_stiffness(m->tendon_stiffness[i], m->tendon_stiffnesspoly + mjNPOLY * i)) continue;
    add_tendon(m, d, i, spring_force(m, d, i), now_);
    add_tendon(m, ahead_.get(), i, spring_force(m, ahead_.get(), i), then_);
  }
}

// Those of what a servo has a part in; at the end of its range its force stays.
void ElasticForces::add_servos(const mjModel* m, const mjData* d) {
  if (m->opt.disableflags & mjDSBL_ACTUATION) return;
  for (int i = 0; i < m->nactuator; ++i) {
    const double stiffness = servo_stiffness(m, d, i);
    if (stiffness == 0.0) continue;
    const int output = m->actuator_outadr[i];
    const double force = d->actuator_force[output];
    const double stretch = ahead_->actuator_length[output] - d->actuator_length[output];
    add_actuator(m, d, i, force, now_);
    add_actuator(m, ahead_.get(), i, force - stiffness * stretch, then_);
  }
  for (int i = 0; i < m->nv; ++i) servo_change_[i] = then_[i] - now_[i];
}

void ElasticForces::add_joints(const mjModel* m, const mjData* d) {
  if (m->opt.disableflags & mjDSBL_SPRING) return;
  for (int i = 0; i < m->njnt; ++i) {
    if (!has_spring(m, i)) continue;
    const int q = m->jnt_qposadr[i], dof = m->jnt_dofadr[i];
    for (auto [data, force] : {std::pair{d, &now_}, {ahead_.get(), &then_}}) {
      mjtNum orientation[4], turn[3], way[3];
      mju_copy4(orientation, data->qpos + q + 3);
      mju_normalize4(orientation);
      mju_subQuat(turn, orientation, m->qpos_spring + q + 3);
      mju_sub3(way, data->qpos + q, m->qpos_spring + q);
      add_spring(m, i, way, force->data() + dof);
      add_spring(m, i, turn, force->data() + dof + 3);
    }
  }
}

double flex_energy(const mjModel_* m, const mjData_* d) {
  double energy = 0.0;
  if (m->opt.disableflags & mjDSBL_SPRING) return energy;
  for (int flex = 0; flex < m->nflex; ++flex) {
    if (m->flex_rigid[flex] || m->flex_interp[flex] || m->flex_dim[flex] < 2) continue;
    if (m->flex_stiffnessadr[flex] >= 0) energy += stretch_energy(m, d, flex);
    if (m->flex_bendingadr[flex] >= 0) energy += bending_energy(m, d, flex);
  }
  return energy;
}

}  // namespace dashpot::host
