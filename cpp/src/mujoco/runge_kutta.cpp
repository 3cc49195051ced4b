#include "dashpot/mujoco/runge_kutta.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/mujoco/data_checks.hpp"
#include "dashpot/mujoco/errors.hpp"
#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/host.hpp"
#include "dashpot/mujoco/properties.hpp"
#include "dashpot/mujoco/sleep.hpp"
#include "dashpot/mujoco/trees.hpp"
#include "dashpot/rows/divergence.hpp"

namespace dashpot::host {

namespace {

// Where in the step a stage lies, as a fraction of it, which is also the weight of the slope that
// leads there; and the weights of all slopes.
constexpr double kPlace[] = {0.0, 0.5, 0.5, 1.0};
constexpr double kWeight[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};

constexpr int kInputs = mjSTATE_CTRL | mjSTATE_QFRC_APPLIED | mjSTATE_XFRC_APPLIED;
constexpr int kState = mjSTATE_TIME | mjSTATE_QPOS | mjSTATE_QVEL | mjSTATE_ACT | kInputs;

void get_state(const mjModel* m, const mjData* d, int kind, std::vector<double>& state) {
  state.resize(mj_stateSize(m, kind));
  mj_getState(m, d, state.data(), kind);
}

}  // namespace

RungeKutta::RungeKutta(bool moves_free_bodies) : moves_free_bodies_(moves_free_bodies) {}

bool is_runge_kutta(const mjModel_* m) { return m->opt.integrator == mjINT_RK4; }
bool has_activations(const mjModel_* m) { return m->na > 0; }

bool others_look_at_stages(const mjModel_* m) {
  return m->nplugin > 0 || mjcb_control || mjcb_passive || mjcb_act_dyn || mjcb_act_gain ||
         mjcb_act_bias;
}

// At its end `d` has the state, contacts and flags that it had when this was made. Contacts and
// rows themselves lie in an arena that the stages leave alone.
class RungeKutta::Start {
 public:
  Start(const mjModel* m, mjData* d, std::vector<double>& state)
      : model_(m),
        data_(d),
        state_(state),
        count_{d->ncon, d->ne, d->nf, d->nl, d->nefc},
        flag_{d->flg_energypos, d->flg_energyvel, d->flg_subtreevel, d->flg_rnepost} {
    get_state(m, d, kState, state);
  }
  ~Start() {
    restore_state();
    data_->ncon = count_[0];
    data_->ne = count_[1];
    data_->nf = count_[2];
    data_->nl = count_[3];
    data_->nefc = count_[4];
    data_->flg_energypos = flag_[0];
    data_->flg_energyvel = flag_[1];
    data_->flg_subtreevel = flag_[2];
    data_->flg_rnepost = flag_[3];
  }
  Start(const Start&) = delete;
  Start& operator=(const Start&) = delete;

  void restore_state() { mj_setState(model_, data_, state_.data(), kState); }

 private:
  const mjModel* model_;
  mjData* data_;
  const std::vector<double>& state_;
  const std::array<int, 5> count_;
  const std::array<mjtBool, 4> flag_;
};

void RungeKutta::find_motion(mjModel_* m, mjData_* d, bool new_control,
                             const std::vector<double>& held, const FindContacts& find_contacts) {
  constraint_force_.assign(d->qfrc_constraint, d->qfrc_constraint + m->nv);
  constrained_ = std::any_of(constraint_force_.begin(), constraint_force_.end(),
                             [](double force) { return force != 0.0; });
  position_.assign(d->qpos, d->qpos + m->nq);
  activation_.assign(d->act, d->act + m->na);
  velocity_[0].assign(d->qvel, d->qvel + m->nv);
  acceleration_[0].assign(d->qacc, d->qacc + m->nv);
  hold(0, held);
  activation_rate_[0].assign(d->act_dot, d->act_dot + m->na);
  read_forces(m, d, 0);
  time_ = d->time;
  find_sleeping_dofs(m, d, sleeping_);
  others_look_ = others_look_at_stages(m);
  if (others_look_) {
    // It would need the contacts of every stage, in the place of those of the step.
    if (has_adhesion(m))
      throw std::runtime_error(
          "adhesion is not stepped with integrator RK4 where callbacks or plugins are asked in its "
          "stages; use Euler or implicitfast");
    start_acceleration_.assign(d->qacc, d->qacc + m->nv);
    Start start(m, d, state_);
    find_slopes(m, d, new_control, held, find_contacts);
    get_state(m, d, kInputs, inputs_);
    start.restore_state();
    smooth_stage(m, d, false, Sensors::kStay, find_contacts);
    std::copy(start_acceleration_.begin(), start_acceleration_.end(), d->qacc);
  } else {
    find_slopes(m, copy_state(m, d), new_control, held, find_contacts);
  }
  find_mean_slope();
  check_mean_slope(m);
  find_mean_forces(m);
}

void RungeKutta::advance(mjModel_* m, mjData_* d) {
  if (others_look_) mj_setState(m, d, inputs_.data(), kInputs);
  // Time, plugins and activations are as with Euler, under the mean slope.
  std::copy(mean_activation_rate_.begin(), mean_activation_rate_.end(), d->act_dot);
  advance_all_but_motion(m, d);
  std::copy(activation_rate_[0].begin(), activation_rate_[0].end(), d->act_dot);
  std::copy(acceleration_.back().begin(), acceleration_.back().end(), d->qacc_warmstart);
  std::copy(velocity_[0].begin(), velocity_[0].end(), d->qvel);
  mju_addToScl(d->qvel, mean_acceleration_.data(), m->opt.timestep, static_cast<int>(m->nv));
  std::copy(position_.begin(), position_.end(), d->qpos);
  mj_integratePos(m, d->qpos, mean_velocity_.data(), m->opt.timestep);
}

mjData* RungeKutta::copy_state(const mjModel* m, const mjData* d) {
  if (!beside_) beside_ = make_data(m);
  mj_copyState(m, d, beside_.get(), mjSTATE_INTEGRATION & ~(mjSTATE_USERDATA | mjSTATE_WARMSTART));
  return beside_.get();
}

void RungeKutta::find_slopes(mjModel* m, mjData* d, bool new_control,
                             const std::vector<double>& held, const FindContacts& find_contacts) {
  const ErrorGuard guard(d);
  for (int stage = 1; stage < kStages; ++stage) {
    go_to_stage(m, d, stage);
    smooth_stage(m, d, new_control, Sensors::kStay, find_contacts);
    read_slope(m, d, stage);
    hold(stage, held);
    read_forces(m, d, stage);
  }
}

void RungeKutta::go_to_stage(const mjModel* m, mjData* d, int stage) {
  const double part = kPlace[stage], h = m->opt.timestep;
  const auto move = [&](double* x, const std::vector<double>& start,
                        const std::vector<double>& slope, std::vector<double>& scaled) {
    scaled.assign(slope.size(), 0.0);
    mju_addToScl(scaled.data(), slope.data(), part, static_cast<int>(slope.size()));
    std::copy(start.begin(), start.end(), x);
    mju_addToScl(x, scaled.data(), h, static_cast<int>(slope.size()));
  };
  mean_velocity_.assign(m->nv, 0.0);
  mju_addToScl(mean_velocity_.data(), velocity_[stage - 1].data(), part, static_cast<int>(m->nv));
  std::copy(position_.begin(), position_.end(), d->qpos);
  mj_integratePos(m, d->qpos, mean_velocity_.data(), h);
  move(d->qvel, velocity_[0], acceleration_[stage - 1], mean_acceleration_);
  move(d->act, activation_, activation_rate_[stage - 1], mean_activation_rate_);
  d->time = time_ + part * h;
}

void RungeKutta::read_slope(const mjModel* m, mjData* d, int stage) {
  if (constrained_) {
    mj_solveM(m, d, d->qacc, constraint_force_.data(), 1);
    mju_addTo(d->qacc, d->qacc_smooth, static_cast<int>(m->nv));
  } else {
    std::copy(d->qacc_smooth, d->qacc_smooth + m->nv, d->qacc);
  }
  velocity_[stage].assign(d->qvel, d->qvel + m->nv);
  acceleration_[stage].assign(d->qacc, d->qacc + m->nv);
  for (int dof : sleeping_) acceleration_[stage][dof] = 0.0;
  activation_rate_[stage].assign(d->act_dot, d->act_dot + m->na);
}

void RungeKutta::hold(int stage, const std::vector<double>& held) {
  for (size_t i = 0; i < held.size(); ++i)
    if (!std::isnan(held[i])) acceleration_[stage][i] = held[i];
}

void RungeKutta::find_mean_slope() {
  const auto average = [](const std::array<std::vector<double>, kStages>& slope,
                          std::vector<double>& mean) {
    mean.assign(slope[0].size(), 0.0);
    for (int stage = 0; stage < kStages; ++stage)
      mju_addToScl(mean.data(), slope[stage].data(), kWeight[stage], static_cast<int>(mean.size()));
  };
  average(velocity_, mean_velocity_);
  average(acceleration_, mean_acceleration_);
  average(activation_rate_, mean_activation_rate_);
}

void RungeKutta::check_mean_slope(const mjModel* m) const {
  for (int i = 0; i < m->nv; ++i) {
    if (!moves_free_bodies_ && is_free_body(m, m->dof_treeid[i])) continue;
    if (!(std::abs(mean_velocity_[i]) <= kLargestValue &&
          std::abs(mean_acceleration_[i]) <= kLargestValue))
      throw DivergenceError("motion of degree of freedom " + std::to_string(i) +
                            " diverged between the stages of RK4; data are as they were before "
                            "the step");
  }
}

void RungeKutta::read_forces(const mjModel* m, const mjData* d, int stage) {
  smooth_force_[stage].assign(d->qfrc_smooth, d->qfrc_smooth + m->nv);
  driving_forces(m, d, driving_force_[stage]);
  damping_forces(m, d, damping_force_[stage]);
}

void RungeKutta::find_mean_forces(const mjModel* m) {
  const auto find = [&](const std::array<std::vector<double>, kStages>& force, StageForce& found) {
    found.mean.assign(m->nv, 0.0);
    found.work_of_changes.assign(m->nv, 0.0);
    for (int i = 0; i < m->nv; ++i) {
      double& mean = found.mean[i];
      double& work = found.work_of_changes[i];
      for (int stage = 0; stage < kStages; ++stage) mean += kWeight[stage] * force[stage][i];
      for (int stage = 0; stage < kStages; ++stage)
        work += m->opt.timestep * kWeight[stage] * (force[stage][i] - mean) *
                (velocity_[stage][i] - mean_velocity_[i]);
    }
  };
  find(smooth_force_, forces_.smooth);
  find(driving_force_, forces_.driving);
  find(damping_force_, forces_.damping);
}

}  // namespace dashpot::host
