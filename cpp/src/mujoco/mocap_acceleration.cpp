#include "dashpot/mujoco/mocap_acceleration.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

namespace dashpot::host {

namespace {

// An acceleration grows steadily where it grew as much in the step before, but for this part of the
// larger growth; where it does not, it is at most so many times that of the step before.
constexpr double kSteadyGrowth = 0.5, kMostGrowth = 2.0;

using Vector = std::array<double, 3>;

double norm(const Vector& v) { return mju_norm3(v.data()); }
Vector times(double factor, const Vector& v) {
  return {factor * v[0], factor * v[1], factor * v[2]};
}
Vector difference(const Vector& from, const Vector& to) {
  return {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
}

}  // namespace

Vector accelerate(const Vector& velocity, double between, MeanRate& mean) {
  const MeanRate before = mean;
  mean.velocity = velocity;
  mean.change = times(1.0 / between, difference(before.velocity, velocity));
  const Vector growth = difference(before.change, mean.change);
  // What sets out had no acceleration that could grow.
  const bool sets_out = norm(before.change) + norm(before.growth) < kSteadyGrowth * norm(growth);
  mean.growth = sets_out ? Vector{} : growth;
  Vector ahead = mean.change;
  mju_addToScl3(ahead.data(), growth.data(), 0.5);
  if (norm(difference(before.growth, growth)) <=
      kSteadyGrowth * std::max(norm(growth), norm(before.growth)))
    return ahead;
  const double along = mju_dot3(ahead.data(), before.change.data());
  if (along <= 0.0) return {};
  return times(std::min(1.0, kMostGrowth * along / mju_dot3(ahead.data(), ahead.data())), ahead);
}

}  // namespace dashpot::host
