// Many open-loop rollouts on threads.
//
// The state after step k of rollout i is the state that one Stepper on one thread would reach from
// initial state i: results are identical bit for bit for every number of threads.

#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "dashpot/simulations/simulation_host.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

// Simulations of one model that workers borrow, kept from call to call: to make one, and what it
// learns about the hulls of meshes, takes as long as a hundred steps.
class SimulationPool {
 public:
  explicit SimulationPool(const Parameters& parameters) : parameters_(parameters) {}

  // A simulation of `model` as it is now: one that is free, or a new one. `model`: the same every
  // time, or one of its sizes; meshes stay those of the first one. Threads may borrow at once.
  std::unique_ptr<Simulation> borrow(const mjModel_* model);
  void give_back(std::unique_ptr<Simulation> simulation);

 private:
  Parameters parameters_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Simulation>> free_;
};

// A borrowed simulation, given back at the latest when this goes.
class SimulationLoan {
 public:
  SimulationLoan() = default;
  ~SimulationLoan() { give_back(); }
  SimulationLoan(const SimulationLoan&) = delete;
  SimulationLoan& operator=(const SimulationLoan&) = delete;

  // The simulation that is borrowed already, where it is of this pool, or else one of it.
  Simulation& of(SimulationPool& pool, const mjModel_* model);

 private:
  void give_back();

  SimulationPool* pool_ = nullptr;
  std::unique_ptr<Simulation> simulation_;
};

// What one rollout steps.
struct RolloutModel {
  const mjModel_* model = nullptr;
  SimulationPool* simulations = nullptr;  // of that model alone
};

struct RolloutInput {
  int nbatch = 0;
  int nstep = 0;
  int spec = kFullPhysics;                // of the initial states, bits of mjtState
  const double* initial_state = nullptr;  // (nbatch, state_size(model, spec))
  // (nbatch, nstep, ncontrol) or null. Null with full-physics states: zero; with integration
  // states: the controls in the state, held.
  const double* control = nullptr;
  int control_spec = 0;  // what `control` holds, bits of mjtState
  int ncontrol = 0;      // length of a vector of that
  // Steps are to be differentiated: the last states have all of their velocities.
  bool differentiable = false;
  // A rollout that diverges has NaN from there on, and the others go on.
  bool fills_diverged = false;
};

// A rollout that diverged, and how.
struct Divergence {
  int rollout = 0, step = 0;
  std::string what;
};

// Vectors of which most numbers are zero, as contact memory is: the others, with their places.
struct SparseRows {
  std::vector<double> value;
  std::vector<std::int32_t> place;
  std::vector<std::int64_t> row_end;  // in `value`
  void add(const double* row, int size);
};

// What is written after every step, or, `last_state`, after the last one. Where a rollout diverged
// there is NaN, and there are no rows of `sparse`.
struct RolloutOutput {
  int record = kFullPhysics;
  double* state = nullptr;       // (nbatch, nstep, nstate by `record`), or null
  double* sensordata = nullptr;  // (nbatch, nstep, nsensordata)
  double* last_state = nullptr;  // (nbatch, nstate of integration), or null
  SparseRows* sparse = nullptr;  // (nbatch), of integration states, or null
};

// Rolls out. Full-physics states start without contact memory, integration states carry it.
// `models`: one for all, or one for each rollout, all of the same sizes. `nthread` 0: one per core.
// Returns those that diverged, in order, where they are filled. Throws std::invalid_argument,
// DivergenceError naming rollout and step, and what `interrupt` throws between steps.
std::vector<Divergence> roll_out(const std::vector<RolloutModel>& models, const RolloutInput& input,
                                 const RolloutOutput& output, int nthread,
                                 const Interrupt& interrupt = {});

}  // namespace dashpot
