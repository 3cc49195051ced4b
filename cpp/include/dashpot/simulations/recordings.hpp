// What simulations show to those who compare them with recordings: calibration.
//
// A recording says what is read of one motion, and after which steps: poses of bodies, numbers of
// sensors, gaps between geoms. Readings that positions and velocities make are those of the end of
// the step. What needs accelerations and forces is held through a step, and read as its mean over
// the last steps, as recorders take it; where no step comes before, it is 0.
//
// A variant is a model with parameters; an item is a variant that makes one recorded motion from an
// initial state. All items are simulated in one parallel batch.

#pragma once

#include <string>
#include <utility>
#include <vector>

#include "dashpot/simulations/simulation_host.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

// A model and how it steps: with dashpot, or with mj_step where `parameters` is null.
struct Variant {
  const mjModel_* model = nullptr;
  const Parameters* parameters = nullptr;
};

// One number of sensordata.
struct Channel {
  int address = 0;
  bool mean = false;  // over the last `interval` steps; else of the end of the step
};

// What is read of one motion.
struct Recording {
  std::string name;
  double timestep = 0.0;         // s, of the simulation
  std::vector<int> record_step;  // steps from the start to each reading, ascending, >= 0
  std::vector<int> body;
  std::vector<Channel> channel;
  // Pairs of geoms, of which the least signed distance is read (m); none: no gap.
  std::vector<std::pair<int, int>> gap;
  std::vector<double> control;  // (last record_step, nu), or empty: zero
  int interval = 1;             // steps that means are taken over

  int row() const { return 7 * int(body.size()) + int(channel.size()) + (gap.empty() ? 0 : 1); }
  int size() const { return int(record_step.size()) * row(); }
};

// A variant, a recording (indices) and the initial state; without contact memory.
struct Item {
  int variant = 0, recording = 0;
  const double* qpos = nullptr;  // (nq,)
  const double* qvel = nullptr;  // (nv,)
};

// Throws std::invalid_argument naming recording and field whose size, order or value does not fit.
void check(const Recording& recording, const ModelSizes& sizes);

// Simulates every item and writes its readings to its place in `readings`, one after the other,
// each (record_step, row): poses (bodies, 7) of position (m) and quaternion (w x y z), then
// channels, then the gap. Returns by item why its simulation failed, naming recording and step, and
// empty where it did not. Identical bit for bit for every `nthread` (0: one per core). Throws what
// `interrupt` throws, which is asked between steps, and std::invalid_argument as check() does.
std::vector<std::string> record(const std::vector<Variant>& variants,
                                const std::vector<Recording>& recordings,
                                const std::vector<Item>& items, int nthread, double* readings,
                                const Interrupt& interrupt = {});

}  // namespace dashpot
