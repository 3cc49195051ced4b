// How far apart contacts of a pair of geoms are looked for.
//
// The reach of every geom is how far it goes in the world (detect/reach.hpp), but links of a
// robot go together. A pair is narrowed to how far its geoms may go against each other, at the
// velocities of both ends of the step. What forces of the step add to that is looked at afterwards
// (impact_propagation.hpp); a pair that an impact is known to bring together is looked for by its
// ways in the world.

#pragma once

#include <vector>

#include "dashpot/detect/candidates.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct ReachBuffers;

// Keeps its array from step to step.
class Narrowing {
 public:
  // `reach` is to outlive its use.
  void start(const ReachBuffers& reach);
  // The distance (m) within which contacts of a pair are looked for, pair.within or less; where it
  // is less, the pair is appended to `narrowed`.
  double within(const mjModel_* m, const mjData_* d, const CandidatePair& pair,
                std::vector<NarrowedPair>& narrowed) const;
  // Those of the present detection.
  std::vector<NarrowedPair>& pairs() { return pairs_; }

 private:
  const ReachBuffers* reach_ = nullptr;
  std::vector<NarrowedPair> pairs_;
};

}  // namespace dashpot::host
