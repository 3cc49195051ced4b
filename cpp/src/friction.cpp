// Radial return to the elliptic limit surface: equations in friction.hpp.

#include "dashpot/friction.hpp"

#include <cmath>

namespace dashpot {
namespace {

// Within these the sum of squares has lost nothing to underflow or overflow.
constexpr double kSmallestSquare = 1e-280;
constexpr double kLargestSquare = 1e300;

}  // namespace

double radial_return(const double* impulse, const double* mu, int n, double normal_impulse) {
  double square = 0.0;
  for (int i = 0; i < n; ++i) {
    if (mu[i] > 0.0) {
      const double ratio = impulse[i] / mu[i];
      square += ratio * ratio;
    }
  }
  if (square > kSmallestSquare && square < kLargestSquare) {
    return square <= normal_impulse * normal_impulse ? 1.0 : normal_impulse / std::sqrt(square);
  }
  double length = 0.0;
  for (int i = 0; i < n; ++i) {
    if (mu[i] > 0.0) length = std::hypot(length, impulse[i] / mu[i]);
  }
  return length <= normal_impulse ? 1.0 : normal_impulse / length;
}

}  // namespace dashpot
