// Many open-loop rollouts of one model on threads.
//
// The state after step k of rollout i is the state that one Stepper on one thread would reach from
// initial state i: results are identical bit for bit for every number of threads.

#pragma once

#include "dashpot/simulation_host.hpp"

namespace dashpot {

struct RolloutInput {
  int nbatch = 0;
  int nstep = 0;
  StateKind kind = StateKind::kFullPhysics;
  const double* initial_state = nullptr;  // (nbatch, nstate), nstate by `kind`
  // (nbatch, nstep, nu) or null. Null with full-physics states: zero; with integration states: the
  // controls in the state, held.
  const double* control = nullptr;
};

// Rolls out and writes after every step `state` (nbatch, nstep, nstate) and `sensordata` (nbatch,
// nstep, nsensordata). Full-physics states start without contact memory, integration states carry
// it. `nthread` 0: one per core. Throws std::invalid_argument naming rollout and step where one
// fails.
void rollout(const mjModel_* model, const Parameters& parameters, const RolloutInput& input,
             int nthread, double* state, double* sensordata);

}  // namespace dashpot
