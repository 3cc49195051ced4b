// Return to the elliptic limit surface: equations in friction.hpp.

#include "dashpot/law/friction.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {
namespace {

// Within these the sum of squares has lost nothing to underflow or overflow.
constexpr double kSmallestSquare = 1e-280;
constexpr double kLargestSquare = 1e300;

}  // namespace

double share_under_load(double s, double F, double normal_force) {
  return s + (1.0 - s) / (1.0 + normal_force / F);
}

double radial_return(const double* impulse, const double* mu, int n, double normal_impulse) {
  double square = 0.0;
  for (int i = 0; i < n; ++i) {
    if (mu[i] > 0.0) {
      const double ratio = impulse[i] / mu[i];
      square += ratio * ratio;
    }
  }
  if (square > kSmallestSquare && square < kLargestSquare)
    return square <= normal_impulse * normal_impulse ? 1.0 : normal_impulse / std::sqrt(square);
  double length = 0.0;
  for (int i = 0; i < n; ++i)
    if (mu[i] > 0.0) length = std::hypot(length, impulse[i] / mu[i]);
  return length <= normal_impulse ? 1.0 : normal_impulse / length;
}

// With z_i = t_i / (mu_i p_n), a_i = c_i / mu_i^2 and |q|^2 = sum (z_i / (1 + gamma a_i))^2, Newton
// solves 1 / |q| = 1. The left side is increasing and concave in gamma (and linear where all a_i
// agree), so that from gamma = 0 every round stays outside the surface and comes nearer.
bool return_to_limit(double* impulse, const double* mu, const double* response, int n,
                     double normal_impulse) {
  for (int i = 0; i < n; ++i)
    if (mu[i] == 0.0) impulse[i] = 0.0;
  double scale = radial_return(impulse, mu, n, normal_impulse);
  if (scale >= 1.0) return true;
  double z[kMaxFrictionDirections], a[kMaxFrictionDirections], largest = 0.0;
  for (int i = 0; i < n; ++i) {
    const bool carries = impulse[i] != 0.0 && scale > 0.0;
    z[i] = carries ? impulse[i] / mu[i] / normal_impulse : 0.0;
    a[i] = carries ? response[i] / mu[i] / mu[i] : 0.0;
    largest = std::max(largest, a[i]);
  }
  if (largest > 0.0 && std::isfinite(largest)) {
    double gamma = 0.0;  // in units of 1 / largest
    for (int i = 0; i < n; ++i) a[i] /= largest;
    for (int round = 0; round < kMaxRounds; ++round) {
      double square = 0.0, slope = 0.0;
      for (int i = 0; i < n; ++i) {
        const double shrink = 1.0 / (1.0 + gamma * a[i]);
        const double q = z[i] * shrink;
        square += q * q;
        slope += q * q * a[i] * shrink;
      }
      const double excess = std::sqrt(square) - 1.0;
      if (!(excess > kOnSurface) || !std::isfinite(square) || slope == 0.0) break;
      const double next = gamma + excess * square / slope;
      if (!std::isfinite(next)) break;  // a direction that does not respond is beyond the surface
      gamma = next;
    }
    for (int i = 0; i < n; ++i) impulse[i] /= 1.0 + gamma * a[i];
    scale = radial_return(impulse, mu, n, normal_impulse);
  }
  for (int i = 0; i < n; ++i) impulse[i] *= scale;
  return false;
}

}  // namespace dashpot
