#include "dashpot/mujoco_host.hpp"

#include <mujoco/mjxmacro.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "dashpot/mujoco_errors.hpp"
#include "dashpot/mujoco_owned.hpp"

// Exported by the pinned MuJoCo library though not declared in its public headers: derivatives of
// the smooth forces with respect to velocity, which mj_implicit itself starts from.
extern "C" void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);

namespace dashpot::host {

static_assert(kLargestValue == mjMAXVAL);

namespace {

void check_finite(const std::string& field, double value) {
  if (!std::isfinite(value))
    throw std::invalid_argument("data." + field + " is " + std::to_string(value) +
                                "; it must be finite");
}

void check_finite(const char* field, const mjtNum* values, mjtSize count) {
  for (mjtSize i = 0; i < count; ++i)
    if (!std::isfinite(values[i]))
      check_finite(std::string(field) + "[" + std::to_string(i) + "]", values[i]);
}

// Whether the effective inertia of a tree is that of a rigid body alone: a free body without
// armature, and without forces that the integrator treats implicitly.
bool has_rigid_body_inertia(const mjModel* m, const mjData* d, int tree) {
  if (!is_free_body(m, tree)) return false;
  const int begin = m->tree_dofadr[tree];
  for (int dof = begin; dof < begin + m->tree_dofnum[tree]; ++dof) {
    if (m->dof_armature[dof] != 0.0) return false;
    if (joint_damping_weight(m) > 0.0 && joint_damping(m, dof, d->qvel[dof]) != 0.0) return false;
    if (takes_derivatives(m))
      for (int k = m->D_rowadr[dof]; k < m->D_rowadr[dof] + m->D_rownnz[dof]; ++k)
        if (d->qDeriv[k] != 0.0) return false;
  }
  return std::all_of(m->tendon_armature, m->tendon_armature + m->ntendon,
                     [](mjtNum armature) { return armature == 0.0; });
}

// In the form of Trees::inverse for free bodies.
void invert_body_inertia(const mjModel* m, const mjData* d, int tree, double* inverse) {
  const int body = m->dof_bodyid[m->tree_dofadr[tree]];
  const mjtNum* rotation = d->ximat + 9 * body;
  const mjtNum* moments = m->body_inertia + 3 * body;
  for (int i = 0; i < 3; ++i) inverse[i] = 1.0 / m->body_mass[body];
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

// Factor of the effective inertia, row-major and dof_count wide.
void factor_tree(const mjModel* m, const mjData* d, const Trees& trees, int tree, double* factor) {
  const Tree& t = trees.tree[tree];
  const double h = m->opt.timestep;
  const bool derived = takes_derivatives(m);
  const double weight = joint_damping_weight(m);
  std::fill_n(factor, t.dof_count * t.dof_count, 0.0);
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    for (int k = m->M_rowadr[dof]; k < m->M_rowadr[dof] + m->M_rownnz[dof]; ++k) {
      double& entry = factor[i * t.dof_count + m->M_colind[k] - t.dof_begin];
      entry = d->M[k];
      if (derived) entry -= h * d->qDeriv[m->mapD2M[k]];
    }
    if (weight > 0.0)
      factor[i * t.dof_count + i] += weight * h * joint_damping(m, dof, d->qvel[dof]);
  }
  factor_inertia(trees, tree, factor);
}

}  // namespace

long long data_size(const mjModel_* m) { return make_data(m)->nbuffer; }

bool have_same_sizes(const mjModel_* a, const mjModel_* b) {
#define X(size) \
  if (a->size != b->size) return false;
  MJMODEL_SIZES
#undef X
  return true;
}

void check_data(const mjModel_* m, const mjData_* d, long long data_size) {
  const bool both_signed = d->signature != 0 && m->signature != 0;
  if ((both_signed && d->signature != m->signature) || d->nbuffer != data_size)
    throw std::invalid_argument(
        "data was made from another model; make it with Engine.make_data()");
  if (!std::isfinite(d->time)) check_finite("time", d->time);
  check_finite("qpos", d->qpos, m->nq);
  check_finite("qvel", d->qvel, m->nv);
  check_finite("act", d->act, m->na);
  check_finite("ctrl", d->ctrl, m->nu);
  check_finite("qfrc_applied", d->qfrc_applied, m->nv);
  for (int i = 0; i < 6 * m->nbody; ++i)
    if (!std::isfinite(d->xfrc_applied[i]))
      check_finite("xfrc_applied[" + std::to_string(i / 6) + ", " + std::to_string(i % 6) +
                       "] (body " + named(m, mjOBJ_BODY, i / 6) + ")",
                   d->xfrc_applied[i]);
  check_finite("mocap_pos", d->mocap_pos, 3 * m->nmocap);
  check_finite("mocap_quat", d->mocap_quat, 4 * m->nmocap);
}

std::string named(const mjModel_* m, int type, int id) {
  const char* name = mj_id2name(m, type, id);
  return name && *name ? "'" + std::string(name) + "'" : "#" + std::to_string(id);
}

std::string contact_side(const mjModel_* m, int geom) {
  return geom < 0 ? "flex " + named(m, mjOBJ_FLEX, -1 - geom)
                  : "geom " + named(m, mjOBJ_GEOM, geom);
}

int geom_count(const mjModel_* m) { return static_cast<int>(m->ngeom); }
int dof_count(const mjModel_* m) { return static_cast<int>(m->nv); }

StepParts::StepParts(mjModel_* m, mjData_* d)
    : model_(m), data_(d), timestep_(m->opt.timestep), end_(d->time + m->opt.timestep) {}

StepParts::~StepParts() {
  if (!cut()) return;
  model_->opt.timestep = timestep_;
  if (finished_)
    data_->time = end_;
  else
    mj_setState(model_, data_, start_.data(), mjSTATE_INTEGRATION);
}

void StepParts::set_length(double length) {
  if (!cut()) {
    start_.resize(mj_stateSize(model_, mjSTATE_INTEGRATION));
    mj_getState(model_, data_, start_.data(), mjSTATE_INTEGRATION);
  }
  model_->opt.timestep = length;
}

std::array<double, 3> geom_friction(const mjModel_* m, int geom) {
  const mjtNum* f = geom < 0 ? m->flex_friction + 3 * (-1 - geom) : m->geom_friction + 3 * geom;
  return {f[0], f[1], f[2]};
}

int geom_tree(const mjModel_* m, int geom) { return m->body_treeid[m->geom_bodyid[geom]]; }

int geom_priority(const mjModel_* m, int geom) {
  return geom < 0 ? m->flex_priority[-1 - geom] : m->geom_priority[geom];
}

double contact_radius(const mjModel_* m, const ContactInput& input) {
  double radius = std::numeric_limits<double>::infinity();
  for (int geom : input.geom)
    if (geom >= 0 && m->geom_rbound[geom] > 0.0) radius = std::min(radius, m->geom_rbound[geom]);
  return radius;
}

double contact_mass(const mjModel_* m, const ContactInput& input) {
  double mass = std::numeric_limits<double>::infinity();
  if (input.is_of_flex()) return mass;
  for (int geom : input.geom) {
    const int tree = m->body_treeid[m->geom_bodyid[geom]];
    if (tree >= 0) mass = std::min(mass, m->body_subtreemass[m->tree_bodyadr[tree]]);
  }
  return mass;
}

double gravity(const mjModel_* m) {
  return m->opt.disableflags & mjDSBL_GRAVITY ? 0.0 : mju_norm3(m->opt.gravity);
}

int flex_count(const mjModel_* m) { return static_cast<int>(m->nflex); }
bool has_equalities(const mjModel_* m) { return m->neq > 0; }
int mocap_count(const mjModel_* m) { return static_cast<int>(m->nmocap); }

int contact_site_count(const mjModel_* m) { return static_cast<int>(m->ngeom + m->nflexvert); }

bool may_collide(const mjModel_* m, int geom) {
  return m->geom_contype[geom] || m->geom_conaffinity[geom] || m->npair > 0;
}

int colliding_mesh_count(const mjModel_* m) {
  int count = 0;
  for (int geom = 0; geom < m->ngeom; ++geom)
    count += m->geom_type[geom] == mjGEOM_MESH && may_collide(m, geom);
  return count;
}

double geom_inverse_mass(const mjModel_* m, int geom) {
  return m->body_invweight0[2 * m->geom_bodyid[geom]];
}

void reserve_memory(mjModel_* m, int size) { m->nuserdata += size; }

double* memory(const mjModel_* m, mjData_* d, int size) {
  return d->userdata + (m->nuserdata - size);
}

bool has_adhesion(const mjModel_* m) {
  const int* types = m->actuator_trntype;
  return m->flg_adhesion || std::count(types, types + m->nactuator, mjTRN_BODY) > 0;
}

void smooth_stage(const mjModel_* m, mjData_* d, bool new_control) {
  const bool adhesive = has_adhesion(m);
  d->ncon = d->ne = d->nf = d->nl = d->nefc = 0;
  d->flg_energypos = d->flg_energyvel = d->flg_subtreevel = d->flg_rnepost = 0;
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  mj_factorM(m, d);
  // Adhesion, of actuators or of geoms, pulls along the normals of the contacts of the present
  // positions. They need no rows: MuJoCo takes contacts inside the gap (exclude 1) without.
  if (adhesive) call_with_callbacks(mj_collision, m, d);
  for (int i = 0; i < d->ncon; ++i)
    if (d->contact[i].exclude == 0) d->contact[i].exclude = 1;
  mj_transmission(m, d);
  call_with_callbacks(mj_fwdVelocity, m, d);
  d->ncon = 0;
  if (new_control && mjcb_control && !(m->opt.disableflags & mjDSBL_ACTUATION))
    call_with_callbacks(mjcb_control, m, d);
  call_with_callbacks(mj_fwdActuation, m, d);
  mj_fwdAcceleration(m, d);
}

Trees make_trees(const mjModel_* m) {
  Trees trees;
  const int count = tree_count(m);
  for (int i = 0; i < count; ++i)
    trees.append(m->tree_dofadr[i], m->tree_dofnum[i], is_free_body(m, i),
                 m->dof_parentid + m->tree_dofadr[i]);
  return trees;
}

void prepare_effective_inertia(const mjModel_* m, mjData_* d) {
  if (takes_derivatives(m)) mjd_smooth_vel(m, d, 0);
}

void find_effective_inertia(const mjModel_* m, const mjData_* d, Trees& trees) {
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    Tree& t = trees.tree[index];
    t.free_body = has_rigid_body_inertia(m, d, index);
    if (t.free_body)
      invert_body_inertia(m, d, index, trees.inverse.data() + t.inverse);
    else
      factor_tree(m, d, trees, index, trees.factor.data() + t.inverse);
  }
}

void smooth_acceleration(const mjData_* d, const Trees& trees, int tree, double* acceleration) {
  const Tree& t = trees.tree[tree];
  if (t.free_body) {
    std::copy_n(d->qacc_smooth + t.dof_begin, t.dof_count, acceleration);
    return;
  }
  std::copy_n(d->qfrc_smooth + t.dof_begin, t.dof_count, acceleration);
  solve_inertia(trees, tree, trees.factor.data() + t.inverse, acceleration);
}

bool is_free_body(const mjModel_* m, int tree) {
  const int joint = m->dof_jntid[m->tree_dofadr[tree]];
  return m->tree_bodynum[tree] == 1 && m->jnt_type[joint] == mjJNT_FREE;
}

Eigen::Quaterniond orientation(const mjModel_* m, const mjData_* d, int tree) {
  const mjtNum* q = d->xquat + 4 * m->dof_bodyid[m->tree_dofadr[tree]];
  return {q[0], q[1], q[2], q[3]};
}

FreeBody read_free_body(const mjModel_* m, const mjData_* d, int tree, const double* acceleration) {
  const int dof = m->tree_dofadr[tree];
  const int body = m->dof_bodyid[dof];
  const mjtNum* q = d->qpos + m->jnt_qposadr[m->dof_jntid[dof]];
  const mjtNum* principal = m->body_iquat + 4 * body;
  FreeBody free;
  free.mass = m->body_mass[body];
  free.inertia = Eigen::Map<const Eigen::Vector3d>(m->body_inertia + 3 * body);
  free.principal = {principal[0], principal[1], principal[2], principal[3]};
  free.offset = Eigen::Map<const Eigen::Vector3d>(m->body_ipos + 3 * body);
  free.origin = Eigen::Map<const Eigen::Vector3d>(q);
  free.orientation = orientation(m, d, tree);
  free.velocity = Eigen::Map<const Vector6>(d->qvel + dof);
  free.acceleration = Eigen::Map<const Vector6>(acceleration);
  return free;
}

void write_free_body(const mjModel_* m, mjData_* d, int tree, const FreeBody& body) {
  const int dof = m->tree_dofadr[tree];
  mjtNum* q = d->qpos + m->jnt_qposadr[m->dof_jntid[dof]];
  std::copy_n(body.origin.data(), 3, q);
  q[3] = body.orientation.w();
  std::copy_n(body.orientation.vec().data(), 3, q + 4);
  std::copy_n(body.velocity.data(), 6, d->qvel + dof);
}

const double* velocity(const mjData_* d) { return d->qvel; }
const double* position(const mjData_* d) { return d->qpos; }
int position_count(const mjModel_* m) { return static_cast<int>(m->nq); }

void report_forces(const mjModel_* m, mjData_* d, const std::vector<double>& constraint_force,
                   const std::vector<ContactInput>& contacts,
                   const std::vector<ConstraintInput>& constraints, const Rows& rows,
                   const std::vector<double>& row_force) {
  std::copy(constraint_force.begin(), constraint_force.end(), d->qfrc_constraint);
  std::copy(d->qacc_smooth, d->qacc_smooth + m->nv, d->qacc);
  const bool any = std::any_of(constraint_force.begin(), constraint_force.end(),
                               [](double force) { return force != 0.0; });
  if (any) {
    thread_local std::vector<double> acceleration;  // a step allocates nothing
    acceleration.resize(m->nv);
    mj_solveM(m, d, acceleration.data(), constraint_force.data(), 1);
    mju_addTo(d->qacc, acceleration.data(), static_cast<int>(m->nv));
  }
  if (d->nefc > 0) mju_zero(d->efc_force, d->nefc);
  for (const RowGroup& c : rows.group) {
    const int address = c.kind == RowKind::kContact
                            ? d->contact[contacts[c.input].source].efc_address
                            : constraints[c.input].source;
    if (address >= 0) std::copy_n(row_force.begin() + c.row, c.dim, d->efc_force + address);
  }
  call_with_callbacks(mj_sensorAcc, m, d);
}

bool takes_derivatives(const mjModel_* m) {
  return m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST;
}

double joint_damping_weight(const mjModel_* m) {
  if (takes_derivatives(m) || (m->opt.disableflags & mjDSBL_DAMPER)) return 0.0;
  if (is_runge_kutta(m)) return 0.5;
  return m->opt.disableflags & mjDSBL_EULERDAMP ? 0.0 : 1.0;
}

bool adds_to_smooth_motion(const mjModel_* m) {
  return is_runge_kutta(m) || m->opt.integrator == mjINT_IMPLICIT;
}

void integrate(const mjModel_* m, mjData_* d, bool new_control, RungeKutta& runge_kutta) {
  if (is_runge_kutta(m))
    runge_kutta.advance(m, d, new_control);
  else if (takes_derivatives(m))
    mj_implicit(m, d);
  else
    mj_Euler(m, d);
}

void add_velocity(mjData_* d, const Tree& t, const double* change) {
  mju_addTo(d->qvel + t.dof_begin, change + t.begin, t.dof_count);
}

void move_tree(const mjModel_* m, mjData_* d, const Tree& t, const double* displacement) {
  for (int joint = m->dof_jntid[t.dof_begin]; joint <= m->dof_jntid[t.dof_begin + t.dof_count - 1];
       ++joint) {
    double* q = d->qpos + m->jnt_qposadr[joint];
    const double* delta = displacement + m->jnt_dofadr[joint] - t.dof_begin;
    switch (m->jnt_type[joint]) {
      case mjJNT_FREE:
        mju_addTo3(q, delta);
        mju_quatIntegrate(q + 3, delta + 3, 1.0);
        break;
      case mjJNT_BALL:
        mju_quatIntegrate(q, delta, 1.0);
        break;
      default:
        q[0] += delta[0];
    }
  }
}

void write_tree(const mjModel_* m, mjData_* d, const Tree& t, const double* start_position,
                const double* displacement, const double* velocity) {
  std::copy_n(velocity, t.dof_count, d->qvel + t.dof_begin);
  const int joint = m->dof_jntid[t.dof_begin],
            next = m->dof_jntid[t.dof_begin + t.dof_count - 1] + 1;
  const int begin = m->jnt_qposadr[joint];
  const int end = next < m->njnt ? m->jnt_qposadr[next] : static_cast<int>(m->nq);
  std::copy(start_position + begin, start_position + end, d->qpos + begin);
  move_tree(m, d, t, displacement);
}

void copy_state(const mjModel_* m, const mjData_* d, mjData_* to) {
  mj_copyState(m, d, to, mjSTATE_INTEGRATION);
}

std::array<double, 2> mechanical_energy(const mjModel_* m, mjData_* d) {
  d->flg_energypos = d->flg_energyvel = 0;
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  mj_comVel(m, d);
  mj_energyPos(m, d);
  mj_energyVel(m, d);
  return {d->energy[1], d->energy[0]};
}

}  // namespace dashpot::host
