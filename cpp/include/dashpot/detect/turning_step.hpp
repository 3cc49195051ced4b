// What is known of a step before its contacts are frozen (turning.hpp).

#pragma once

#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

struct TurningStep {
  double length;    // s
  bool any_motion;  // none is so small that it counts as rest, as where a step is differentiated
  const Trees& trees;
  const double* motion;           // velocities in motion coordinates
  const HitFrequency& frequency;  // of contacts that may be hit
  const Memory& memory;           // of what was hit in the last step
};

}  // namespace dashpot::host
