// Random rows in lanes, for tests of these.

#pragma once

#include <cmath>
#include <random>

#include "dashpot/solve/sweep_kernels.hpp"

namespace dashpot {

inline std::mt19937_64 generator(7);

inline double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
inline double log_uniform(double low, double high) {
  return std::exp(uniform(std::log(low), std::log(high)));
}

// Four groups of rows of any stiffness and damping, some of them open.
template <int Dim>
void fill_rows(double h, RowLanes<Dim>& c) {
  for (int lane = 0; lane < kLanes; ++lane) {
    for (int i = 0; i < Dim; ++i) {
      const double w = c.inverse_mass[i][lane] = log_uniform(0.01, 100.0);
      const double frequency = log_uniform(1e-3, 3.0) / h;
      c.stiffness[i][lane] = frequency * frequency / w;
      c.damping[i][lane] = 2.0 * uniform(0.0, 2.0) * frequency / w;
      c.deformation[i][lane] = uniform(-1e-3, i == 0 ? 2e-4 : 1e-3);
      c.rate[i][lane] = uniform(-0.5, 0.5);
    }
    c.sticking[lane] = -1;
  }
}

// Four contacts, some without friction in a direction.
template <int Dim>
ContactLanes<Dim> random_contacts(double h) {
  ContactLanes<Dim> c{};
  fill_rows(h, c);
  for (int lane = 0; lane < kLanes; ++lane)
    for (int i = 1; i < Dim; ++i) {
      double& inverse = c.inverse_friction[i - 1][lane];
      inverse = uniform(0.0, 1.0) < 0.2 ? 0.0 : 1.0 / log_uniform(0.01, 2.0);
      if (inverse == 0.0) c.stiffness[i][lane] = c.damping[i][lane] = 0.0;
    }
  return c;
}

}  // namespace dashpot
