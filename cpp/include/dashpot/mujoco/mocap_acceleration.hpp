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

#include <array>

#include "dashpot/rows/memory.hpp"

namespace dashpot::host {

// Returns a_n (m/s^2 or rad/s^2) of the mean velocity v_n, whose step has its middle `between` (s)
// after that of the step before, of which `mean` is; that becomes this step's.
std::array<double, 3> accelerate(const std::array<double, 3>& velocity, double between,
                                 MeanRate& mean);

}  // namespace dashpot::host
