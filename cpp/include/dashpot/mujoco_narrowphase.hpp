// Contacts of pairs of geoms. Part of the mujoco_host room.

#pragma once

#include <vector>

#include "dashpot/mujoco_candidates.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Puts the contacts of pairs into `d` as mj_collision does, in their order. Stops with MuJoCo's
// warning where they do not fit into the memory of the model.
void collide_pairs(mjModel_* m, mjData_* d, const std::vector<CandidatePair>& pairs);

}  // namespace dashpot::host
