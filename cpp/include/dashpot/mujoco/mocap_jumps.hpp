// Jumps of the poses of mocap bodies: which of them are motions.
//
// A jump that no motion is meant by takes the body there without any (at_rest): one of more than
// 0.1 m or 0.5 rad, unless the body follows slowly (mocap_motion.hpp) and leaves behind what a
// connect or weld holds to it. A body that nothing is remembered of, and that is farther from what
// it holds than springs bear (2 cm, 0.1 rad), has jumped there from it.

#pragma once

#include <cstddef>

#include "dashpot/mujoco/mocap_places.hpp"
#include "dashpot/rows/memory.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Whether a body goes farther in one step than motions do.
bool is_far(const mjModel_* m, const MocapPose& from, const MocapPose& to);
// Of a body at rest where it is told to be.
RememberedMocap at_rest(const MocapPose& command);

// Has a body that holds something, whose far jump from now.pose to now.command is no motion, begin
// at rest at its end. Leaves the kinematics and rows of `d` at some pose of it.
void settle_jump(const mjModel_* m, mjData_* d, size_t index, MocapPlaces& places,
                 RememberedMocap& now);
// Before the first step of all, has a body that was told to go far from what it holds, as resets do
// to have a hand fetched, begin there. Leaves `d` as settle_jump does.
void settle_start(const mjModel_* m, mjData_* d, size_t index, MocapPlaces& places,
                  RememberedMocap& now);

}  // namespace dashpot::host
