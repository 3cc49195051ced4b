// The sweeps for any processor.

#include "dashpot/sweep_kernels.hpp"

namespace dashpot {

const SweepFunctions kPortableSweeps = kSweeps;

}  // namespace dashpot
