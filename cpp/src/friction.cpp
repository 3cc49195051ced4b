// Radial return to the elliptic limit surface: equations in friction.hpp.

#include "dashpot/friction.hpp"

#include <cmath>

namespace dashpot {

double radial_return(const double* impulse, const double* mu, int n, double normal_impulse) {
  double square = 0.0;
  for (int i = 0; i < n; ++i) {
    if (mu[i] > 0.0) {
      const double ratio = impulse[i] / mu[i];
      square += ratio * ratio;
    }
  }
  if (square <= normal_impulse * normal_impulse) return 1.0;
  return normal_impulse / std::sqrt(square);
}

}  // namespace dashpot
