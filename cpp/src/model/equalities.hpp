// What connects and welds join: an anchor and an orientation of either body, which are to coincide.

#pragma once

#include <array>

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

// The bodies of a connect or weld; the world twice of other equalities.
std::array<int, 2> joined_bodies(const mjModel_* m, int equality);

// One side of a connect or weld: the body, its anchor (m) and its orientation in the world. The
// orientation means nothing in a connect.
struct EqualitySide {
  int body;
  double anchor[3], orientation[4];
};

// Side 0 or 1 of a connect or weld, from the kinematics in `d`.
EqualitySide side_of(const mjModel_* m, const mjData_* d, int equality, int index);

// Position (m) and quaternion of a frame fixed to one side, where the other side is met by moving
// the frame alone: a weld turns it, a connect does not.
std::array<double, 7> where_met(const EqualitySide& moved, const EqualitySide& other, bool weld,
                                const std::array<double, 7>& frame);

}  // namespace dashpot::host
