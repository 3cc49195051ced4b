// Poses that users set in jumps: when a body is to be there, and which jumps are motions.
//
// Poses that follow on one another within 0.1 s (five time constants) have a rhythm: a body goes at
// a constant velocity to be where it is told when the next pose comes. Told in every step it is
// there at the end of the step, and what is seen then is what contacts saw. A single pose, as the
// first of many, is reached at 0.25 m/s, or within a time constant where that is shorter. So no
// jump is a blow: a body that is behind goes at most 1.25 times as fast as it is told to, beyond
// 1 m/s as it was told before too. What a body turns counts as the way of a point 0.1 m away.
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

// Tells a body where to be, at a time (s). One that `follows` has none to be there.
void tell(const mjModel_* m, double time, const MocapPose& command, bool follows,
          double time_constant, RememberedMocap& now);
// Whether what memory has of a body is a motion: not before the first step, nor of other storage.
bool is_known(const RememberedMocap& mocap);
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
