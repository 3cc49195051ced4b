// Simulations of one model that workers borrow, kept from call to call.
//
// To make a simulation, and what it learns about the hulls of meshes, takes as long as a hundred
// steps.

#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "dashpot/simulations/simulation_host.hpp"

namespace dashpot {

class SimulationPool {
 public:
  explicit SimulationPool(const Parameters& parameters) : parameters_(parameters) {}

  // A simulation of `model` as it is now: one that is free, or a new one. `model`: the same every
  // time, or one of its sizes; the vertices of meshes stay those of the first one. Threads may
  // borrow at once.
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

}  // namespace dashpot
