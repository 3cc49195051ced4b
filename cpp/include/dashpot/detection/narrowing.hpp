// How far apart contacts of a pair of geoms are looked for.
//
// The reach of every geom is how far it goes in the world (detection/reach.hpp), but links of a
// robot go together. A pair is narrowed to how far its geoms may go against each other, at the
// velocities of both ends of the step. A pair that an impact is known to bring together is looked
// for by its ways in the world.

#pragma once

#include "dashpot/detection/candidates.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct ReachBuffers;

class Narrowing {
 public:
  // `reach` is to outlive its use.
  void start(const ReachBuffers& reach);
  // The distance (m) within which contacts of a pair are looked for, pair.within or less.
  double within(const mjModel_* m, const mjData_* d, const CandidatePair& pair) const;

 private:
  const ReachBuffers* reach_ = nullptr;
};

}  // namespace dashpot::host
