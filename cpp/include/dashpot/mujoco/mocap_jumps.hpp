// Poses that users set in jumps: when a body is to be there, which jumps are motions, and how these
// accelerate it.
//
// Poses that follow on one another within 0.1 s (five time constants) have a rhythm: a body goes at
// a constant velocity to be where it is told when the next pose comes. Told in every step it is
// there at the end of the step, and what is seen then is what contacts saw. A single pose, as the
// first of many, is reached at 0.25 m/s, or within a time constant where that is shorter. So no
// jump is a blow: a body that is behind goes at most 1.25 times as fast as it is told to, beyond
// 1 m/s as it was told before too. What a body turns counts as the way of a point 0.1 m away.
//
// A jump of more than 0.1 m or 0.5 rad is no motion: the body is there at once (at_rest). But one
// that follows slowly (mocap_motion.hpp) begins where what a connect or weld holds to it is, if
// that is farther than springs bear (2 cm, 0.1 rad); so does one that nothing is remembered of, as
// after resets that have a hand fetched.
//
// Acceleration of mocap bodies within a step.
//
// At a constant velocity in each step, that of a body with the acceleration a would jump by a H
// from one step of length H to the next, and what it carries would slip. So within step n it is
// linear about its mean v_n,
//
//     v(t) = v_n + a_n (t - H_n / 2) ,   a_n = c_n + (c_n - c_n-1) / 2 ,
//     c_n = 2 (v_n - v_n-1) / (H_n + H_n-1) ,
//
// c_n being the acceleration at its start, a_n that in its middle. Of a motion x(t) that goes on
// from step to step jumps of H^3 / 4 x'''' are left. Where one starts, stops or turns back at once,
// a_n would lead on beyond what is asked for, and throw what is carried. There c does not grow as
// in the step before (kSteadyGrowth), and a_n is at most twice c_n-1 (kMostGrowth), and 0 where it
// is against it: a jump of velocity stays one, and what sets out from rest, c_1 = a / 2, has its
// acceleration from the second step on.

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

// Where a body that holds something, and jumped to now.command or has nothing to go on from,
// begins. Leaves the kinematics of `d` at that command.
void settle(const mjModel_* m, mjData_* d, size_t index, MocapPlaces& places, RememberedMocap& now);

// Returns a_n (m/s^2 or rad/s^2) of the mean velocity v_n, whose step has its middle `between` (s)
// after that of the step before, of which `mean` is; that becomes this step's.
std::array<double, 3> accelerate(const std::array<double, 3>& velocity, double between,
                                 MeanRate& mean);

}  // namespace dashpot::host
