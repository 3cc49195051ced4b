// One worker's own simulation: a view of a model, its data and a stepper. Rollouts and recordings
// step through it and so need no mujoco.h.

#pragma once

#include <optional>

#include "dashpot/law/parameters.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/step/engine.hpp"

namespace dashpot {

// Which numbers a vector of mj_getState and mj_setState holds: bits of mjtState.
extern const int kFullPhysics;  // time, qpos, qvel, act, history, plugin state
// Also controls, applied forces, mocap, warm start and user data: contact memory.
extern const int kIntegration;

// Sizes that fix the layout of states and controls.
struct ModelSizes {
  int nq = 0, nv = 0, nu = 0, nbody = 0, ngeom = 0, nsensordata = 0;
  int full_physics = 0, integration = 0;  // lengths of the two state vectors
};
ModelSizes sizes_of(const mjModel_* model);
// Length of a vector of what `spec` names.
int state_size(const mjModel_* model, int spec);

class Simulation {
 public:
  // Of a view of `model`, which must outlive it. Steps with dashpot's Stepper, or with mj_step
  // where `parameters` is null.
  Simulation(const mjModel_* model, const Parameters* parameters);

  // Goes on with the present values of the model, or another of its sizes; meshes stay the first's.
  void update_model(const mjModel_* model);
  // s, > 0.
  void set_timestep(double timestep);
  // Everything as in fresh data of the model: no contact memory, no controls.
  void reset();

  // The vectors have the length state_size(model, spec).
  void set_state(const double* state, int spec);
  void get_state(double* state, int spec) const;
  void set_position_velocity(const double* qpos, const double* qvel);  // (nq,), (nv,)
  void set_control(const double* control);                             // (nu,)
  const double* sensordata() const;                                    // (nsensordata,)

  // Steps once. Throws std::runtime_error where the state is no longer finite afterwards.
  void step();
  // See Stepper::differentiate.
  void differentiate(bool whether);
  // Adds to velocities what the last step left over for the next one (Stepper::complete_last_step).
  void complete_last_step();

  // Body frames of the present state: position (3, m) and quaternion (4, w x y z) in the world.
  void update_kinematics();
  void body_pose(int body, double* position, double* quaternion) const;
  // Signed distance of two geoms there, m; throws as geom_distance() does.
  double distance(int geom1, int geom2) const;

  // Those of sensordata() that positions and velocities make, of the present state; they are of the
  // start of the last step before. Updates kinematics too.
  void update_sensors();

 private:
  // Calls a function of MuJoCo that may call back; throws as step() where that raises.
  void call(void (*function)(const mjModel_*, mjData_*));

  host::ModelView model_;
  host::OwnedData data_;
  std::optional<Stepper> stepper_;
};

}  // namespace dashpot
