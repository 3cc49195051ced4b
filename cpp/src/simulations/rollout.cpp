#include "dashpot/simulations/rollout.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

#include "dashpot/rows/divergence.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

int state_size(const ModelSizes& sizes, StateKind kind) {
  return kind == StateKind::kFullPhysics ? sizes.full_physics : sizes.integration;
}

}  // namespace

std::vector<Divergence> roll_out(const std::vector<RolloutModel>& models, const RolloutInput& input,
                                 int nthread, double* state, double* sensordata,
                                 const Interrupt& interrupt) {
  const ModelSizes sizes = sizes_of(models.front().model);
  const int from = state_size(sizes, input.kind), to = state_size(sizes, input.record);
  const int threads = thread_count(nthread, input.nbatch);
  std::vector<SimulationLoan> loans(threads);
  std::vector<Divergence> diverged(input.fills_diverged ? input.nbatch : 0);

  parallel_for(input.nbatch, threads, interrupt, [&](const Worker& worker, int item) {
    const RolloutModel& own = models[models.size() == 1 ? 0 : item];
    Simulation& simulation = loans[worker.index()].of(*own.simulations, own.model);
    simulation.reset();
    simulation.differentiate(input.differentiable);
    simulation.set_state(input.initial_state + std::size_t(item) * from, input.kind);
    for (int step = 0; step < input.nstep; ++step) {
      worker.look();
      const std::size_t row = std::size_t(item) * input.nstep + step;
      if (input.control) {
        simulation.set_inputs(input.control + row * input.ncontrol, input.control_spec);
      }
      try {
        simulation.step();
        std::copy_n(simulation.sensordata(), sizes.nsensordata,
                    sensordata + row * sizes.nsensordata);
        if (input.differentiable && step + 1 == input.nstep) simulation.complete_last_step();
      } catch (const std::exception& error) {
        const bool diverges = dynamic_cast<const DivergenceError*>(&error);
        if (diverges && input.fills_diverged) {
          const std::size_t rest = input.nstep - step;
          std::fill_n(state + row * to, rest * to, kNaN);
          std::fill_n(sensordata + row * sizes.nsensordata, rest * sizes.nsensordata, kNaN);
          diverged[item] = {item, step, error.what()};
          return;
        }
        const std::string what = "rollout " + std::to_string(item) + ", step " +
                                 std::to_string(step) + ": " + error.what();
        if (diverges) throw DivergenceError(what);
        throw std::invalid_argument(what);
      }
      simulation.get_state(state + row * to, input.record);
    }
  });
  const auto is_none = [](const Divergence& each) { return each.what.empty(); };
  diverged.erase(std::remove_if(diverged.begin(), diverged.end(), is_none), diverged.end());
  return diverged;
}

}  // namespace dashpot
