// Sleeping trees, of models with <flag sleep="enable"/>, in MuJoCo's own fields of mjData.
//
// As MuJoCo asks, a tree is ready to sleep when no force is applied to it and it has been slower
// than opt.sleep_tolerance for mjMINAWAKE steps; it falls asleep with all trees that rows join it
// to, once all of these are ready. MuJoCo's stages then leave it out, and wake it, with those that
// fell asleep with it, where its state or the forces on it are changed. What touches it or is tied
// to it wakes it here.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot::host {

bool may_sleep(const mjModel_* m);  // the flag
bool any_sleeps(const mjModel_* m, const mjData_* d);
bool sleeps(const mjData_* d, int tree);  // false of -1
// Whether one of two geoms sleeps, and the other one does, or is of the world.
bool rest_asleep(const mjModel_* m, const mjData_* d, const std::array<int, 2>& geoms);

// Wakes a tree and those that fell asleep with it.
void wake(const mjModel_* m, mjData_* d, int tree);
// Wakes what equalities hold or held that were switched meanwhile, as memory of their rows tells.
void wake_switched(const mjModel_* m, mjData_* d, const Memory& memory);

// Counts the step for all trees that are awake, and returns those of them that fall asleep, none of
// an island before all of it can. `island` (by tree): its number, -1 for none; `driven` (by tree):
// it has rows with mocap bodies that move; `shift` (by degree of freedom): how fast recovery moves
// positions beside their velocity.
std::vector<int> find_falling_asleep(const mjModel_* m, mjData_* d, const std::vector<int>& island,
                                     const std::vector<char>& driven,
                                     const std::vector<double>& shift);
// Puts them to sleep, at rest where they are.
void put_to_sleep(mjModel_* m, mjData_* d, const std::vector<int>& trees,
                  const std::vector<int>& island);

// The rows that what sleeps would have.
void find_sleeping_rows(const mjModel_* m, const mjData_* d, MarkedRows& sleeping);
// The degrees of freedom of what sleeps.
void find_sleeping_dofs(const mjModel_* m, const mjData_* d, std::vector<int>& dofs);

// While it lives, MuJoCo's integrators put nothing to sleep: they know no islands of ours.
class StaysAwake {
 public:
  StaysAwake(const mjModel_* m, mjData_* d);
  ~StaysAwake();
  StaysAwake(const StaysAwake&) = delete;
  StaysAwake& operator=(const StaysAwake&) = delete;

 private:
  mjData_* data_;
  std::vector<int>& counts_;  // kept by the thread: no allocation in a step
};

// Of a step that is not finished, puts to sleep again what it woke.
class SleepAtStart {
 public:
  // `asleep`: kept from step to step, as a step allocates nothing.
  SleepAtStart(const mjModel_* m, mjData_* d, std::vector<int>& asleep);
  ~SleepAtStart();
  SleepAtStart(const SleepAtStart&) = delete;
  SleepAtStart& operator=(const SleepAtStart&) = delete;

  void finish() { finished_ = true; }

 private:
  const mjModel_* model_;
  mjData_* data_;
  std::vector<int>& asleep_;  // mjData.tree_asleep; empty if nothing sleeps
  bool finished_ = false;
};

}  // namespace dashpot::host
