#include "dashpot/simulations/rollout.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "dashpot/rows/divergence.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

namespace {

int state_size(const ModelSizes& sizes, StateKind kind) {
  return kind == StateKind::kFullPhysics ? sizes.full_physics : sizes.integration;
}

}  // namespace

void Rollouts::run(const mjModel_* model, const RolloutInput& input, int nthread, double* state,
                   double* sensordata, const Interrupt& interrupt) {
  const ModelSizes sizes = sizes_of(model);
  const int from = state_size(sizes, input.kind), to = state_size(sizes, input.record);
  const int threads = thread_count(nthread, input.nbatch);
  if (threads > static_cast<int>(simulations_.size())) simulations_.resize(threads);
  std::vector<char> updated(threads, 0);

  parallel_for(input.nbatch, threads, interrupt, [&](const Worker& worker, int item) {
    std::unique_ptr<Simulation>& own = simulations_[worker.index()];
    if (!own) {
      own = std::make_unique<Simulation>(model, &parameters_);
    } else if (!updated[worker.index()]) {
      own->update_model(model);
    }
    updated[worker.index()] = 1;
    Simulation& simulation = *own;
    simulation.reset();
    simulation.differentiate(input.differentiable);
    simulation.set_state(input.initial_state + std::size_t(item) * from, input.kind);
    for (int step = 0; step < input.nstep; ++step) {
      worker.look();
      const std::size_t row = std::size_t(item) * input.nstep + step;
      if (input.control) simulation.set_control(input.control + row * sizes.nu);
      try {
        simulation.step();
        std::copy_n(simulation.sensordata(), sizes.nsensordata,
                    sensordata + row * sizes.nsensordata);
        if (input.differentiable && step + 1 == input.nstep) simulation.complete_last_step();
      } catch (const std::exception& error) {
        const std::string what = "rollout " + std::to_string(item) + ", step " +
                                 std::to_string(step) + ": " + error.what();
        if (dynamic_cast<const DivergenceError*>(&error)) throw DivergenceError(what);
        throw std::invalid_argument(what);
      }
      simulation.get_state(state + row * to, input.record);
    }
  });
}

}  // namespace dashpot
