// Squared distance of two points.

#pragma once

namespace dashpot {

// Of three coordinates each, m^2.
inline double squared_distance(const double* a, const double* b) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

}  // namespace dashpot
