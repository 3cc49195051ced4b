#include "dashpot/simulations/rollout.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

#include "dashpot/rows/trees.hpp"

namespace dashpot {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// The numbers of one rollout and step in an array (nbatch, nstep, size), or null.
double* at(double* array, std::size_t row, int size) {
  return array ? array + row * size : nullptr;
}

void fill_nan(double* numbers, std::size_t count) {
  if (numbers) std::fill_n(numbers, count, kNaN);
}

}  // namespace

void SparseRows::add(const double* row, int size) {
  constexpr int kAtOnce = 32;
  static const double zeros[kAtOnce] = {};
  for (int begin = 0; begin < size; begin += kAtOnce) {
    const int end = std::min(begin + kAtOnce, size);
    if (std::memcmp(row + begin, zeros, (end - begin) * sizeof(double)) == 0) continue;
    for (int i = begin; i < end; ++i) {
      if (row[i] == 0.0 && !std::signbit(row[i])) continue;
      value.push_back(row[i]);
      place.push_back(i);
    }
  }
  row_end.push_back(static_cast<std::int64_t>(value.size()));
}

std::vector<Divergence> roll_out(const std::vector<RolloutModel>& models, const RolloutInput& input,
                                 const RolloutOutput& output, int nthread,
                                 const Interrupt& interrupt) {
  const ModelSizes sizes = sizes_of(models.front().model);
  const int from = state_size(models.front().model, input.spec);
  const int to = state_size(models.front().model, output.record);
  const int threads = thread_count(nthread, input.nbatch);
  std::vector<SimulationLoan> loans(threads);
  std::vector<std::vector<double>> whole(output.sparse ? threads : 0);  // states, by thread
  std::vector<Divergence> diverged(input.fills_diverged ? input.nbatch : 0);

  parallel_for(input.nbatch, threads, interrupt, [&](const Worker& worker, int item) {
    const RolloutModel& own = models[models.size() == 1 ? 0 : item];
    Simulation& simulation = loans[worker.index()].of(*own.simulations, own.model);
    double* const last = at(output.last_state, item, sizes.integration);
    simulation.reset();
    simulation.differentiate(input.differentiable);
    simulation.set_state(input.initial_state + std::size_t(item) * from, input.spec);
    for (int step = 0; step < input.nstep; ++step) {
      worker.look();
      const std::size_t row = std::size_t(item) * input.nstep + step;
      double* const state = at(output.state, row, to);
      double* const sensors = at(output.sensordata, row, sizes.nsensordata);
      if (input.control)
        simulation.set_state(input.control + row * input.ncontrol, input.control_spec);
      try {
        simulation.step();
        std::copy_n(simulation.sensordata(), sizes.nsensordata, sensors);
        if (input.differentiable && step + 1 == input.nstep) simulation.complete_last_step();
      } catch (const std::exception& error) {
        const bool diverges = dynamic_cast<const DivergenceError*>(&error);
        if (diverges && input.fills_diverged) {
          const std::size_t rest = input.nstep - step;
          fill_nan(state, rest * to);
          fill_nan(sensors, rest * sizes.nsensordata);
          fill_nan(last, sizes.integration);
          diverged[item] = {item, step, error.what()};
          return;
        }
        const std::string what = "rollout " + std::to_string(item) + ", step " +
                                 std::to_string(step) + ": " + error.what();
        if (diverges) throw DivergenceError(what);
        throw std::invalid_argument(what);
      }
      if (state) simulation.get_state(state, output.record);
      if (output.sparse) {
        std::vector<double>& numbers = whole[worker.index()];
        numbers.resize(sizes.integration);
        simulation.get_state(numbers.data(), kIntegration);
        output.sparse[item].add(numbers.data(), sizes.integration);
      }
    }
    if (last) simulation.get_state(last, kIntegration);
  });
  const auto is_none = [](const Divergence& each) { return each.what.empty(); };
  diverged.erase(std::remove_if(diverged.begin(), diverged.end(), is_none), diverged.end());
  return diverged;
}

std::unique_ptr<Simulation> SimulationPool::borrow(const mjModel_* model) {
  std::unique_ptr<Simulation> simulation;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!free_.empty()) {
      simulation = std::move(free_.back());
      free_.pop_back();
    }
  }
  if (!simulation) return std::make_unique<Simulation>(model, &parameters_);
  simulation->update_model(model);
  return simulation;
}

void SimulationPool::give_back(std::unique_ptr<Simulation> simulation) {
  const std::lock_guard<std::mutex> lock(mutex_);
  free_.push_back(std::move(simulation));
}

Simulation& SimulationLoan::of(SimulationPool& pool, const mjModel_* model) {
  if (pool_ != &pool) {
    give_back();
    simulation_ = pool.borrow(model);
    pool_ = &pool;
  }
  return *simulation_;
}

void SimulationLoan::give_back() {
  if (pool_) pool_->give_back(std::move(simulation_));
  pool_ = nullptr;
}

}  // namespace dashpot
