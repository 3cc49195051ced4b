#include "dashpot/sweeps.hpp"

namespace dashpot {

#if defined(__x86_64__)
bool has_avx2() { return __builtin_cpu_supports("avx2"); }

bool has_avx512() {
  return has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
         __builtin_cpu_supports("avx512dq");
}

const SweepFunctions& fastest_sweeps() {
  if (has_avx512()) return kAvx512Sweeps;
  return has_avx2() ? kAvx2Sweeps : kPortableSweeps;
}
#else
const SweepFunctions& fastest_sweeps() { return kPortableSweeps; }
#endif

}  // namespace dashpot
