#include "dashpot/rows/hit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dashpot {

namespace {

// Cosine of the angle between pushes up to which they come from one side.
constexpr double kOneSide = 0.5;

// 1 - s cot s
double one_less_cotangent(double s) {
  if (s < 1e-2) return s * s * (1.0 / 3.0 + s * s / 45.0);  // to s^6, where the two terms cancel
  return 1.0 - s / std::tan(s);
}

}  // namespace

double centre_of_hit(double frequency, double compression, double closing_speed,
                     double acceleration, double time) {
  // The spring's place under the load, and how far it swings from there.
  const double balance = acceleration / (frequency * frequency);
  const double swing = std::hypot(compression + balance, closing_speed / frequency);
  double phase = std::atan2(frequency * (compression + balance), closing_speed);
  if (phase < -0.5 * kPi) phase += 2.0 * kPi;  // it opens, though a load presses it
  const double release = kPi - std::asin(std::clamp(balance / swing, -1.0, 1.0)) - phase;
  const double s = 0.5 * std::min(release, frequency * time), end = 2.0 * s / frequency;
  const double centre = (s + one_less_cotangent(s) / std::tan(phase + s)) / frequency;
  const double swung = 2.0 * swing * std::sin(phase + s) * std::sin(s) / frequency;
  const double impulse = swung - balance * end;
  if (balance == 0.0 || impulse <= 0.0) return centre;
  return (swung * centre - 0.5 * balance * end * end) / impulse;
}

bool joins_same_trees(const std::array<int, 2>& a, const std::array<int, 2>& b) {
  return (a[0] == b[0] && a[1] == b[1]) || (a[0] == b[1] && a[1] == b[0]);
}

double onset_in(double length, double gap, double closing_speed) {
  if (gap <= 0.0) return 0.0;
  return gap < length * closing_speed ? gap / closing_speed
                                      : std::numeric_limits<double>::infinity();
}

double deepest_of_hit(double onset, double frequency) { return onset + 0.5 * kPi / frequency; }

bool disturbs_hit(double onset, const std::array<double, 3>& normal,
                  const std::array<double, 3>& normal_of_hit, double deepest) {
  if (onset <= deepest) return true;
  double cosine = 0.0;
  for (int i = 0; i < 3; ++i) cosine += normal[i] * normal_of_hit[i];
  return !std::isinf(onset) && cosine < kOneSide;
}

}  // namespace dashpot
