// Where in a step its present part is.

#pragma once

namespace dashpot {

struct StepClock {
  double whole = 0.0;          // s, of the step
  double rest = 0.0;           // s, of the step from the start of the part on
  double length = 0.0;         // H, s, of the part, which is the whole step if nothing cuts it
  double row_turn_rate = 0.0;  // rad/s, of equalities in the part before; 0 in the first
  bool cut_short = false;      // the part ends at an impact
  int cuts = 0;                // at impacts, in the parts before
};

}  // namespace dashpot
