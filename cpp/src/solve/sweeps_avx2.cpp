// The sweeps for processors with AVX2. CMakeLists.txt has the flags of this file.

#if defined(__x86_64__)

#if !defined(__AVX2__)
#error "to be compiled for AVX2"
#endif

#include "dashpot/solve/sweep_kernels.hpp"

namespace dashpot {

const SweepFunctions kAvx2Sweeps = kSweeps;

}  // namespace dashpot

#endif
