#include "dashpot/law/solref.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dashpot/law/text.hpp"

namespace dashpot {

namespace {

// MuJoCo's mjMINIMP, mjMAXIMP and mjMINVAL.
constexpr double kMinimumImpedance = 1e-4;
constexpr double kMaximumImpedance = 0.9999;
constexpr double kMinimumValue = 1e-15;

constexpr int kMaxRounds = 30;  // far more than it takes
// Of the width, over which impedance changes by less than 1: it is right to about as much.
constexpr double kResolvedWidth = 1e-10;

// Gauss and Legendre's points and weights over [0, 1].
constexpr std::array<std::array<double, 2>, 8> kGauss{{{0.019855071751231912, 0.05061426814518813},
                                                       {0.10166676129318664, 0.11119051722668724},
                                                       {0.2372337950418355, 0.15685332293894363},
                                                       {0.4082826787521751, 0.1813418916891810},
                                                       {0.5917173212478249, 0.1813418916891810},
                                                       {0.7627662049581645, 0.15685332293894363},
                                                       {0.8983332387068134, 0.11119051722668724},
                                                       {0.9801449282487681, 0.05061426814518813}}};

double clip_impedance(double value) {
  return std::clamp(value, kMinimumImpedance, kMaximumImpedance);
}

// MuJoCo's default power is 2, and this is asked of every contact many times.
double power_of(double base, double power) {
  return power == 2.0 ? base * base : std::pow(base, power);
}

// d at the deformation x where d^2 k x = (1 - d) load, by regula falsi (Illinois) inside the width.
double impedance_at_rest(const std::array<double, 5>& solimp, double stiffness, double load) {
  const double width = solimp[2];
  const auto excess = [&](double x) {
    const double d = impedance(solimp, x);
    return d * d * stiffness * x - (1.0 - d) * load;
  };
  if (width <= kMinimumValue || excess(width) <= 0.0) return impedance(solimp, width);
  double low = 0.0, high = width, below = excess(low), above = excess(high), x = high;
  int side = 0;
  for (int round = 0; round < kMaxRounds && high - low > kResolvedWidth * width; ++round) {
    x = (low * above - high * below) / (above - below);
    const double at = excess(x);
    if (at == 0.0) break;
    if (at < 0.0) {
      low = x;
      below = at;
      if (side < 0) above *= 0.5;
      side = -1;
    } else {
      high = x;
      above = at;
      if (side > 0) below *= 0.5;
      side = 1;
    }
  }
  return impedance(solimp, x);
}

}  // namespace

double impedance(const std::array<double, 5>& solimp, double gap) {
  const double start = clip_impedance(solimp[0]);
  const double end = clip_impedance(solimp[1]);
  const double width = solimp[2];
  const double midpoint = clip_impedance(solimp[3]);
  const double power = std::max(1.0, solimp[4]);
  if (width <= kMinimumValue) return 0.5 * (start + end);
  const double x = std::abs(gap) / width;
  if (x >= 1.0) return end;
  // The two halves are alike, seen from their ends.
  const bool below = x <= midpoint;
  const double along = below ? x : 1.0 - x, half = below ? midpoint : 1.0 - midpoint;
  const double part = half * power_of(along / half, power);
  return start + (below ? part : 1.0 - part) * (end - start);
}

std::array<double, 2> solref_to_spring(double ref0, double ref1, double impedance_width) {
  if (!(impedance_width > 0.0 && impedance_width <= 1.0)) {
    throw std::invalid_argument("impedance_width (solimp d_width) must be in (0, 1], got " +
                                text(impedance_width));
  }
  if (std::isfinite(ref0) && std::isfinite(ref1)) {
    if (ref0 > 0.0 && ref1 > 0.0) {
      const double rate = 1.0 / (impedance_width * ref0);
      return {rate / ref1 * (rate / ref1), 2.0 * rate};
    }
    if (ref0 <= 0.0 && ref1 <= 0.0)
      return {-ref0 / (impedance_width * impedance_width), -ref1 / impedance_width};
  }
  throw std::invalid_argument(
      "solref must be two positive numbers (timeconst, dampratio) or two that are not positive "
      "(-stiffness, -damping), got (" +
      text(ref0) + ", " + text(ref1) + ")");
}

std::array<double, 2> solref_to_spring_at_rest(const std::array<double, 2>& solref,
                                               const std::array<double, 5>& solimp, double load,
                                               double part) {
  const auto [k, b] = solref_to_spring(solref[0], solref[1], clip_impedance(solimp[1]));
  const double d = impedance_at_rest(solimp, k, load);
  return {d * d * k / (1.0 - d), d * b / std::sqrt((1.0 - d) * (1.0 - d * (1.0 - part)))};
}

std::array<double, 2> solref_spring_at(const std::array<double, 2>& solref,
                                       const std::array<double, 5>& solimp, double deformation) {
  const auto [k, b] = solref_to_spring(solref[0], solref[1], clip_impedance(solimp[1]));
  const double d = impedance(solimp, deformation);
  return {d * d * k / (1.0 - d), d * b / std::sqrt(1.0 - d)};
}

// Impedance has a corner at the midpoint, and near the end of the width 1 - d may fall by orders of
// magnitude: x goes there as the square of what is summed over.
double solref_energy_at(const std::array<double, 2>& solref, const std::array<double, 5>& solimp,
                        double deformation) {
  const double k = solref_to_spring(solref[0], solref[1], clip_impedance(solimp[1]))[0];
  const double width = std::max(0.0, solimp[2]), middle = clip_impedance(solimp[3]) * width;
  const auto load = [&](double x) {
    const double d = impedance(solimp, x);
    return d * d * k * x / (1.0 - d);
  };
  const double below = std::min(deformation, middle), above = std::min(deformation, width);
  const double first = std::sqrt(width - below), last = std::sqrt(width - above);
  double energy = 0.0;
  for (const auto& [place, weight] : kGauss) {
    energy += weight * below * load(place * below);
    const double root = first + place * (last - first);
    energy += weight * (first - last) * 2.0 * root * load(width - root * root);
  }
  const double beyond = std::max(0.0, deformation - width);
  return energy + beyond * load(width + 0.5 * beyond);
}

}  // namespace dashpot
