#include "dashpot/simulation_host.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "dashpot/engine.hpp"
#include "dashpot/mujoco_errors.hpp"

namespace dashpot {
namespace {

int signature(StateKind kind) {
  return kind == StateKind::kFullPhysics ? mjSTATE_FULLPHYSICS : mjSTATE_INTEGRATION;
}

// MuJoCo's own notion of a bad state (mj_checkPos), read before it would print and reset.
bool all_usable(const mjtNum* values, int count) {
  for (int i = 0; i < count; ++i) {
    if (!(std::abs(values[i]) <= mjMAXVAL)) return false;
  }
  return true;
}

struct ModelDeleter {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};

}  // namespace

ModelSizes sizes_of(const mjModel_* model) {
  ModelSizes sizes;
  sizes.nq = static_cast<int>(model->nq);
  sizes.nv = static_cast<int>(model->nv);
  sizes.nu = static_cast<int>(model->nu);
  sizes.nbody = static_cast<int>(model->nbody);
  sizes.nsensordata = static_cast<int>(model->nsensordata);
  sizes.full_physics = static_cast<int>(mj_stateSize(model, mjSTATE_FULLPHYSICS));
  sizes.integration = static_cast<int>(mj_stateSize(model, mjSTATE_INTEGRATION));
  return sizes;
}

ModelCopy::ModelCopy(const mjModel_* model) : model_(mj_copyModel(nullptr, model), mj_deleteModel) {
  if (!model_) throw std::runtime_error("mj_copyModel failed");
}

struct Simulation::Impl {
  std::unique_ptr<mjModel, ModelDeleter> model;
  std::unique_ptr<mjData, DataDeleter> data;
  std::optional<Stepper> stepper;
};

Simulation::Simulation(const mjModel_* model, const Parameters* parameters)
    : impl_(std::make_unique<Impl>()) {
  impl_->model.reset(mj_copyModel(nullptr, model));
  if (!impl_->model) throw std::runtime_error("mj_copyModel failed");
  if (parameters) impl_->stepper.emplace(impl_->model.get(), *parameters);
  impl_->data.reset(mj_makeData(impl_->model.get()));
  if (!impl_->data) throw std::runtime_error("mj_makeData failed");
}

Simulation::~Simulation() = default;

void Simulation::set_timestep(double timestep) { impl_->model->opt.timestep = timestep; }

void Simulation::reset() { mj_resetData(impl_->model.get(), impl_->data.get()); }

void Simulation::set_state(const double* state, StateKind kind) {
  mj_setState(impl_->model.get(), impl_->data.get(), state, signature(kind));
}

void Simulation::get_state(double* state, StateKind kind) const {
  mj_getState(impl_->model.get(), impl_->data.get(), state, signature(kind));
}

void Simulation::set_position_velocity(const double* qpos, const double* qvel) {
  std::copy_n(qpos, impl_->model->nq, impl_->data->qpos);
  std::copy_n(qvel, impl_->model->nv, impl_->data->qvel);
}

void Simulation::set_control(const double* control) {
  std::copy_n(control, impl_->model->nu, impl_->data->ctrl);
}

const double* Simulation::sensordata() const { return impl_->data->sensordata; }

void Simulation::step() {
  mjModel* model = impl_->model.get();
  mjData* data = impl_->data.get();
  try {
    if (impl_->stepper) {
      impl_->stepper->step(data, 1, false);
    } else {
      const host::ErrorGuard guard(data);
      host::call_with_callbacks(mj_step, model, data);
    }
  } catch (const host::CallbackError&) {
    throw std::runtime_error(
        "callbacks of MuJoCo's Python package raise here, where data are not made in Python; clear "
        "them (mujoco.set_mjcb_control(None) and the like), or step data of Engine.make_data()");
  }
  if (!all_usable(data->qpos, static_cast<int>(model->nq)) ||
      !all_usable(data->qvel, static_cast<int>(model->nv))) {
    throw std::runtime_error("the state is no longer finite");
  }
}

void Simulation::update_kinematics() { mj_kinematics(impl_->model.get(), impl_->data.get()); }

void Simulation::body_pose(int body, double* position, double* quaternion) const {
  std::copy_n(impl_->data->xpos + 3 * body, 3, position);
  std::copy_n(impl_->data->xquat + 4 * body, 4, quaternion);
}

}  // namespace dashpot
