// How messages call what MuJoCo's rows come from. Part of the mujoco_host room.

#pragma once

#include <string>

#include "dashpot/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// The joint, tendon or equality that a scalar constraint of the last detection comes from, and what
// of it: "limit of joint 'knee'".
std::string constraint_name(const mjModel_* m, const mjData_* d, const ConstraintInput& input);

}  // namespace dashpot::host
