// Many open-loop rollouts of one model on threads.
//
// The state after step k of rollout i is the state that one Stepper on one thread would reach from
// initial state i: results are identical bit for bit for every number of threads.

#pragma once

#include <memory>
#include <vector>

#include "dashpot/simulations/simulation_host.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

struct RolloutInput {
  int nbatch = 0;
  int nstep = 0;
  StateKind kind = StateKind::kFullPhysics;    // of the initial states
  StateKind record = StateKind::kFullPhysics;  // of the states that are written
  const double* initial_state = nullptr;       // (nbatch, nstate), nstate by `kind`
  // (nbatch, nstep, nu) or null. Null with full-physics states: zero; with integration states: the
  // controls in the state, held.
  const double* control = nullptr;
  // Steps are to be differentiated: the last states have all of their velocities.
  bool differentiable = false;
};

// The workers of rollouts of one model, kept from call to call: to make one, and what it learns
// about the hulls of meshes, takes as long as a hundred steps.
class Rollouts {
 public:
  explicit Rollouts(const Parameters& parameters) : parameters_(parameters) {}

  // Rolls out and writes after every step `state` (nbatch, nstep, nstate by `record`) and
  // `sensordata` (nbatch, nstep, nsensordata). Full-physics states start without contact memory,
  // integration states carry it. `model`: the same in every call, or one of its sizes; its values
  // are those of the call, but for the vertices of meshes, which stay those of the first one.
  // `nthread` 0: one per core. Throws std::invalid_argument, or DivergenceError, naming rollout and
  // step where one fails, and what `interrupt` throws, which is asked between steps. One call at a
  // time.
  void run(const mjModel_* model, const RolloutInput& input, int nthread, double* state,
           double* sensordata, const Interrupt& interrupt = {});

 private:
  Parameters parameters_;
  std::vector<std::unique_ptr<Simulation>> simulations_;  // by worker
};

}  // namespace dashpot
