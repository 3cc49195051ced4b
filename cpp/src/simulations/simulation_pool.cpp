#include "dashpot/simulations/simulation_pool.hpp"

#include <utility>

namespace dashpot {

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
