#include "dashpot/model/state.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>

#include "dashpot/model/errors.hpp"

namespace dashpot::host {

namespace {

int first_joint(const mjModel* m, const Tree& t) { return m->dof_jntid[t.dof_begin]; }

int last_joint(const mjModel* m, const Tree& t) {
  return m->dof_jntid[t.dof_begin + t.dof_count - 1];
}

void move_tree(const mjModel* m, mjData* d, const Tree& t, const double* displacement) {
  for (int joint = first_joint(m, t); joint <= last_joint(m, t); ++joint) {
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

struct Array {
  mjtNum* mjModel::*values;
  std::size_t count;
};

// What WidenedReach changes.
std::vector<Array> detection_distances(const mjModel* m) {
  const auto size = [](auto count) { return static_cast<std::size_t>(count); };
  return {{&mjModel::geom_gap, size(m->ngeom)},  {&mjModel::body_margin, size(m->nbody)},
          {&mjModel::pair_gap, size(m->npair)},  {&mjModel::flex_gap, size(m->nflex)},
          {&mjModel::jnt_margin, size(m->njnt)}, {&mjModel::tendon_margin, size(m->ntendon)}};
}

// MocapMotion has moved mocap bodies, and puts them back.
constexpr int kState = mjSTATE_INTEGRATION & ~(mjSTATE_MOCAP_POS | mjSTATE_MOCAP_QUAT);

}  // namespace

const double* position(const mjData_* d) { return d->qpos; }
const double* velocity(const mjData_* d) { return d->qvel; }

Eigen::Quaterniond orientation(const mjModel_* m, const mjData_* d, int tree) {
  const mjtNum* q = d->xquat + 4 * m->dof_bodyid[m->tree_dofadr[tree]];
  return {q[0], q[1], q[2], q[3]};
}

FreeBody read_free_body(const mjModel_* m, const mjData_* d, int tree, const WeldedParts* parts,
                        const double* acceleration) {
  const int dof = m->tree_dofadr[tree];
  const int body = m->dof_bodyid[dof];
  const mjtNum* q = d->qpos + m->jnt_qposadr[m->dof_jntid[dof]];
  FreeBody free;
  if (parts) {
    free.mass = parts->mass();
    free.inertia = parts->moments();
    free.principal = parts->principal();
    free.offset = parts->offset();
  } else {
    const mjtNum* principal = m->body_iquat + 4 * body;
    free.mass = m->body_mass[body];
    free.inertia = Eigen::Map<const Eigen::Vector3d>(m->body_inertia + 3 * body);
    free.principal = {principal[0], principal[1], principal[2], principal[3]};
    free.offset = Eigen::Map<const Eigen::Vector3d>(m->body_ipos + 3 * body);
  }
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

void set_velocity(mjData_* d, const std::vector<double>& velocity) {
  std::copy(velocity.begin(), velocity.end(), d->qvel);
}

void add_velocity(mjData_* d, const Tree& t, const double* change) {
  mju_addTo(d->qvel + t.dof_begin, change, t.dof_count);
}

void write_tree(const mjModel_* m, mjData_* d, const Tree& t, const double* start_position,
                const double* displacement, const double* velocity) {
  std::copy_n(velocity, t.dof_count, d->qvel + t.dof_begin);
  const int next = last_joint(m, t) + 1;
  const int begin = m->jnt_qposadr[first_joint(m, t)];
  const int end = next < m->njnt ? m->jnt_qposadr[next] : static_cast<int>(m->nq);
  std::copy(start_position + begin, start_position + end, d->qpos + begin);
  move_tree(m, d, t, displacement);
}

void copy_state(const mjModel_* m, const mjData_* d, mjData_* to) {
  mj_copyState(m, d, to, mjSTATE_INTEGRATION);
}

void reserve_memory(mjModel_* m, int size) { m->nuserdata += size; }

double* memory(const mjModel_* m, mjData_* d, int size) {
  return d->userdata + (m->nuserdata - size);
}

ModelView::ModelView(const mjModel* model) : view_(std::make_unique<mjModel>()) { update(model); }

ModelView::ModelView(ModelView&&) noexcept = default;

ModelView::~ModelView() = default;

void ModelView::update(const mjModel* model) {
  *view_ = *model;
  const std::vector<Array> arrays = detection_distances(model);
  std::size_t total = 0;
  for (const Array& array : arrays) total += array.count;
  own_.resize(total);
  double* next = own_.data();
  for (const Array& array : arrays) {
    std::copy_n(model->*array.values, array.count, next);
    view_.get()->*array.values = next;
    next += array.count;
  }
}

void DataDeleter::operator()(mjData_* d) const { mj_deleteData(d); }

OwnedData make_data(const mjModel_* m) {
  const ErrorGuard guard;
  OwnedData data(mj_makeData(m));
  if (!data) throw MujocoError("MuJoCo could not make data for the model");
  return data;
}

Substeps::Substeps(mjModel_* m, mjData_* d)
    : model_(m), data_(d), timestep_(m->opt.timestep), end_(d->time + m->opt.timestep) {}

Substeps::~Substeps() {
  if (!cut()) return;
  model_->opt.timestep = timestep_;
  if (finished_)
    data_->time = end_;
  else
    mj_setState(model_, data_, start_.data(), kState);
}

void Substeps::set_length(double length) {
  if (!cut()) {
    start_.resize(mj_stateSize(model_, kState));
    mj_getState(model_, data_, start_.data(), kState);
  }
  model_->opt.timestep = length;
}

void Substeps::end_substep() {
  if (!cut() || model_->nhistory == 0) return;
  if (history_.empty())
    history_.assign(data_->history, data_->history + model_->nhistory);
  else
    std::copy(history_.begin(), history_.end(), data_->history);
}

}  // namespace dashpot::host
