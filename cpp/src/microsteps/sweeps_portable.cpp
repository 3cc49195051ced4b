// The sweeps for any processor.

#define DASHPOT_LANES_OF_HALVES

#include "dashpot/microsteps/sweep_kernels.hpp"

namespace dashpot {

const SweepFunctions kPortableSweeps = kSweeps;

}  // namespace dashpot
