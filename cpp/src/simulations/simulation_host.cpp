#include "dashpot/simulations/simulation_host.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/simulations/distances.hpp"

namespace dashpot {

const int kFullPhysics = mjSTATE_FULLPHYSICS;
const int kIntegration = mjSTATE_INTEGRATION;

namespace {

[[noreturn]] void refuse_callbacks() {
  throw std::runtime_error(
      "callbacks of MuJoCo's Python package raise here, where data are not made in Python; clear "
      "them (mujoco.set_mjcb_control(None) and the like), or step data of Engine.make_data()");
}

}  // namespace

ModelSizes sizes_of(const mjModel_* model) {
  ModelSizes sizes;
  sizes.nq = static_cast<int>(model->nq);
  sizes.nv = static_cast<int>(model->nv);
  sizes.nu = static_cast<int>(model->nu);
  sizes.nbody = static_cast<int>(model->nbody);
  sizes.ngeom = static_cast<int>(model->ngeom);
  sizes.nsensordata = static_cast<int>(model->nsensordata);
  sizes.full_physics = static_cast<int>(mj_stateSize(model, mjSTATE_FULLPHYSICS));
  sizes.integration = static_cast<int>(mj_stateSize(model, mjSTATE_INTEGRATION));
  return sizes;
}

int state_size(const mjModel_* model, int spec) {
  return static_cast<int>(mj_stateSize(model, spec));
}

Simulation::Simulation(const mjModel_* model, const Parameters* parameters) : model_(model) {
  update_model(model);
  if (parameters) stepper_.emplace(model_.get(), *parameters);
  data_ = host::make_data(model_.get());
}

void Simulation::update_model(const mjModel_* model) {
  model_.update(model);
  // A diverging run has to be seen, not silently started over.
  model_.get()->opt.disableflags |= mjDSBL_AUTORESET;
}

void Simulation::set_timestep(double timestep) { model_.get()->opt.timestep = timestep; }

void Simulation::reset() { mj_resetData(model_.get(), data_.get()); }

void Simulation::set_state(const double* state, int spec) {
  mj_setState(model_.get(), data_.get(), state, spec);
}

void Simulation::get_state(double* state, int spec) const {
  mj_getState(model_.get(), data_.get(), state, spec);
}

void Simulation::set_position_velocity(const double* qpos, const double* qvel) {
  std::copy_n(qpos, model_.get()->nq, data_->qpos);
  std::copy_n(qvel, model_.get()->nv, data_->qvel);
}

void Simulation::set_control(const double* control) {
  std::copy_n(control, model_.get()->nu, data_->ctrl);
}

const double* Simulation::sensordata() const { return data_->sensordata; }

void Simulation::call(void (*function)(const mjModel*, mjData*)) {
  try {
    const host::ErrorGuard guard(data_.get());
    host::call_with_callbacks(function, model_.get(), data_.get());
  } catch (const host::CallbackError&) {
    refuse_callbacks();
  }
}

void Simulation::differentiate(bool whether) { stepper_->differentiate(whether); }

void Simulation::complete_last_step() {
  try {
    stepper_->complete_last_step(data_.get());
  } catch (const host::CallbackError&) {
    refuse_callbacks();
  }
}

void Simulation::step() {
  mjModel* model = model_.get();
  mjData* data = data_.get();
  if (stepper_) {
    try {
      stepper_->step(data, 1, false);
    } catch (const host::CallbackError&) {
      refuse_callbacks();
    }
  } else {
    call(mj_step);
  }
  // What MuJoCo calls a bad state (mj_checkPos, mj_checkVel).
  if (!host::are_within(data->qpos, model->nq, host::kLargestValue) ||
      !host::are_within(data->qvel, model->nv, host::kLargestValue))
    throw std::runtime_error("the state is no longer finite, or beyond 1e10");
}

void Simulation::update_kinematics() { mj_kinematics(model_.get(), data_.get()); }

void Simulation::update_sensors() {
  mjModel* model = model_.get();
  mjData* data = data_.get();
  // Sensors compute these where no one has since the last step.
  data->flg_energypos = data->flg_energyvel = data->flg_subtreevel = 0;
  mj_fwdKinematics(model, data);
  mj_makeM(model, data);  // of kinetic energy
  mj_transmission(model, data);
  call(mj_fwdVelocity);
  call(mj_sensorPos);
  call(mj_sensorVel);
}

void Simulation::body_pose(int body, double* position, double* quaternion) const {
  std::copy_n(data_->xpos + 3 * body, 3, position);
  std::copy_n(data_->xquat + 4 * body, 4, quaternion);
}

double Simulation::distance(int geom1, int geom2) const {
  return geom_distance(model_.get(), data_.get(), geom1, geom2).distance;
}

}  // namespace dashpot
