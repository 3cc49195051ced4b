// The sweeps for processors with AVX-512. CMakeLists.txt has the flags of this file.

#if defined(__x86_64__)

#if !defined(__AVX512VL__)
#error "to be compiled for AVX-512"
#endif

#include "dashpot/solve/sweep_kernels.hpp"

namespace dashpot {

const SweepFunctions kAvx512Sweeps = kSweeps;

}  // namespace dashpot

#endif
