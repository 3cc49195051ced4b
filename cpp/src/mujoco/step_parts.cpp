#include "dashpot/mujoco/step_parts.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

namespace dashpot::host {

namespace {

// MocapMotion has moved mocap bodies, and puts them back.
constexpr int kState = mjSTATE_INTEGRATION & ~(mjSTATE_MOCAP_POS | mjSTATE_MOCAP_QUAT);

}  // namespace

StepParts::StepParts(mjModel_* m, mjData_* d)
    : model_(m), data_(d), timestep_(m->opt.timestep), end_(d->time + m->opt.timestep) {}

StepParts::~StepParts() {
  if (!cut()) return;
  model_->opt.timestep = timestep_;
  if (finished_)
    data_->time = end_;
  else
    mj_setState(model_, data_, start_.data(), kState);
}

void StepParts::set_length(double length) {
  if (!cut()) {
    start_.resize(mj_stateSize(model_, kState));
    mj_getState(model_, data_, start_.data(), kState);
  }
  model_->opt.timestep = length;
}

void StepParts::end_part() {
  if (!cut() || model_->nhistory == 0) return;
  if (history_.empty())
    history_.assign(data_->history, data_->history + model_->nhistory);
  else
    std::copy(history_.begin(), history_.end(), data_->history);
}

}  // namespace dashpot::host
