// MuJoCo's fourth-order Runge-Kutta integrator under constraint forces that stay as they are over
// the step.
//
// MuJoCo asks its own solver for new constraint forces in each of the four stages. Here rows are
// solved once, over the whole step, and their mean forces F act like applied ones:
//
//     k1 = f(x0),  k2 = f(x0 + H k1 / 2),  k3 = f(x0 + H k2 / 2),  k4 = f(x0 + H k3),
//     x1 = x0 + H (k1 + 2 k2 + 2 k3 + k4) / 6,
//
// x: positions, velocities and activations; accelerations in f are inv(M) (smooth forces + F).
// Where F is zero this is mj_RungeKutta to the bit; where F balances the smooth forces, rest stays.
// Trees that rows hold follow the trapezoidal rule instead, as with other integrators
// (trapezoid.hpp). The stages have them where the mean acceleration of their micro-steps leads.

#pragma once

#include <array>
#include <functional>
#include <vector>

#include "dashpot/mujoco/owned.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Finds the contacts of the present positions, in a room that knows detection.
using FindContacts = std::function<void(mjModel_*, mjData_*)>;

bool is_runge_kutta(const mjModel_* m);
bool has_activations(const mjModel_* m);
// Whether others than MuJoCo may look at the data of a stage, or leave something there.
bool others_look_at_stages(const mjModel_* m);

// A generalized force in the stages, by degree of freedom: its mean, N or N m, and the work, J, of
// what it differs from it by on the way that their velocities differ from their mean by.
struct StageForce {
  std::vector<double> mean, work_of_changes;
};

struct StageForces {
  StageForce smooth;
  // Parts of it: see driving_forces in mujoco/forces.hpp; of dampers and fluids.
  StageForce driving, damping;
};

// Keeps its arrays from step to step.
class RungeKutta {
 public:
  // Unless it `moves_free_bodies`, what comes out for trees that are one free body is not used.
  explicit RungeKutta(bool moves_free_bodies);

  // Finds the motion over the model's time step: `d` has been computed for its present state, up
  // to qacc and qfrc_constraint, and is left so. `new_control` false: within the step the control
  // callback is not asked. `held` (nv): mean accelerations of trees that rows hold, NaN of others,
  // or empty. Where a callback raises, and with std::runtime_error where the motion
  // diverges, or where callbacks or plugins look at the stages of a model with adhesion, state,
  // controls and applied forces are those of the start again.
  void find_motion(mjModel_* m, mjData_* d, bool new_control, const std::vector<double>& held,
                   const FindContacts& find_contacts);
  // Advances everything by it. What was computed stays that of the start.
  void advance(mjModel_* m, mjData_* d);

  // The forces of the last step.
  const StageForces& forces() const { return forces_; }
  // The velocity (nv) that positions went with in the last step.
  const std::vector<double>& mean_velocity() const { return mean_velocity_; }

 private:
  static constexpr int kStages = 4;
  class Start;

  mjData_* copy_state(const mjModel_* m, const mjData_* d);
  void find_slopes(mjModel_* m, mjData_* d, bool new_control, const std::vector<double>& held,
                   const FindContacts& find_contacts);
  void go_to_stage(const mjModel_* m, mjData_* d, int stage);
  void read_slope(const mjModel_* m, mjData_* d, int stage);
  void hold(int stage, const std::vector<double>& held);
  void find_mean_slope();
  void check_mean_slope(const mjModel_* m) const;
  void read_forces(const mjModel_* m, const mjData_* d, int stage);
  void find_mean_forces(const mjModel_* m);

  bool moves_free_bodies_;
  // Where stages are computed, unless callbacks or plugins look at them: those know but the data of
  // the step.
  OwnedData beside_;
  double time_ = 0.0;
  bool constrained_ = false, others_look_ = false;
  std::vector<double> constraint_force_;
  std::vector<int> sleeping_;           // degrees of freedom
  std::vector<double> state_, inputs_;  // at the start; as callbacks left them
  std::vector<double> position_, activation_, start_acceleration_;
  std::array<std::vector<double>, kStages> velocity_, acceleration_, activation_rate_;
  std::vector<double> mean_velocity_, mean_acceleration_, mean_activation_rate_;
  std::array<std::vector<double>, kStages> smooth_force_, driving_force_, damping_force_;
  StageForces forces_;
};

}  // namespace dashpot::host
