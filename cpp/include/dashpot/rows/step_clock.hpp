// Where in a step its present part is.

#pragma once

namespace dashpot {

// What is left of a step, or how far an impact is ahead, counts as nothing below this share of it.
constexpr double kSliverOfStep = 1e-9;

struct StepClock {
  double whole = 0.0;          // s, of the step
  double length = 0.0;         // H, s, of the part, which is the whole step if nothing cuts it
  double uncut = 0.0;          // s, of the shortest part so far, had no impact cut any
  double row_turn_rate = 0.0;  // rad/s, of equalities in the part before; 0 in the first
  bool cut_short = false;      // the part ends at an impact
  int cuts = 0;                // at impacts, in the parts before

  // Positions lead by half of this (motion/leapfrog.hpp), whatever impacts leave of the part: what
  // has flown by steps of H leads by H / 2 in a shorter one, too.
  double stride() const { return cut_short || cuts > 0 ? uncut : length; }
};

}  // namespace dashpot
