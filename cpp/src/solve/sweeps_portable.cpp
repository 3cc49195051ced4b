// The sweeps for any processor.

#define DASHPOT_LANES_OF_HALVES

#include "dashpot/solve/sweep_kernels.hpp"

namespace dashpot {

const SweepFunctions kPortableSweeps = kSweeps;

}  // namespace dashpot
