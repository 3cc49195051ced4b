#include "dashpot/pace.hpp"

#include <algorithm>

namespace dashpot {

namespace {

// Part of the time by which the other way has to be faster: steps differ by as much.
constexpr double kGain = 0.03;
// Trials that change nothing come more and more seldom, until they take no more than 1 % of time.
constexpr int kSeldom = 2048;

void take_least(double seconds, double& least) {
  least = least > 0.0 ? std::min(least, seconds) : seconds;
}

}  // namespace

void Pace::note(double seconds) {
  --left_;
  if (left_ >= 0) {
    if (left_ < kCompared) take_least(seconds, least_);
    return;
  }
  if (-left_ > kUnfit) take_least(seconds, trial_);
  if (-left_ < kUnfit + kCompared) return;
  const bool other_is_faster = trial_ < (1.0 - kGain) * least_;
  if (other_is_faster) shares_ = !shares_;
  interval_ = other_is_faster ? kFirst : std::min(2 * interval_, kSeldom);
  left_ = interval_;
  least_ = trial_ = 0.0;
}

}  // namespace dashpot
