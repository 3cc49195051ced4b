#include "dashpot/rollout.hpp"

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "dashpot/parallel.hpp"

namespace dashpot {

void rollout(const mjModel_* model, const Parameters& parameters, const RolloutInput& input,
             int nthread, double* state, double* sensordata) {
  const ModelSizes sizes = sizes_of(model);
  const int nstate = input.kind == StateKind::kFullPhysics ? sizes.full_physics : sizes.integration;
  const int threads = thread_count(nthread, input.nbatch);
  std::vector<std::unique_ptr<Simulation>> simulations(threads);

  parallel_for(input.nbatch, threads, [&](int worker, int item) {
    if (!simulations[worker]) {
      simulations[worker] = std::make_unique<Simulation>(model, &parameters);
    }
    Simulation& simulation = *simulations[worker];
    simulation.reset();
    simulation.set_state(input.initial_state + std::size_t(item) * nstate, input.kind);
    for (int step = 0; step < input.nstep; ++step) {
      const std::size_t row = std::size_t(item) * input.nstep + step;
      if (input.control) simulation.set_control(input.control + row * sizes.nu);
      try {
        simulation.step();
      } catch (const std::exception& error) {
        throw std::invalid_argument("rollout " + std::to_string(item) + ", step " +
                                    std::to_string(step) + ": " + error.what());
      }
      simulation.get_state(state + row * nstate, input.kind);
      std::copy_n(simulation.sensordata(), sizes.nsensordata, sensordata + row * sizes.nsensordata);
    }
  });
}

}  // namespace dashpot
