#include "dashpot/solve/sweeps.hpp"

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace dashpot {

#if defined(__x86_64__)
bool has_avx2() { return __builtin_cpu_supports("avx2"); }

bool has_avx512() {
  return has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
         __builtin_cpu_supports("avx512dq");
}
#endif

const SweepFunctions& fastest_sweeps() {
  const char* const set = std::getenv(kInstructionSetVariable);
  const std::string asked = set ? set : "";
  const auto is_wanted = [&](const char* name) { return asked.empty() || asked == name; };
#if defined(__x86_64__)
  if (is_wanted("avx512") && has_avx512()) return kAvx512Sweeps;
  if (is_wanted("avx2") && has_avx2()) return kAvx2Sweeps;
#endif
  if (is_wanted("portable")) return kPortableSweeps;
  throw std::invalid_argument(std::string(kInstructionSetVariable) + " is '" + asked +
                              "'; it must be 'portable', 'avx2' or 'avx512', and one that this "
                              "processor has");
}

}  // namespace dashpot
