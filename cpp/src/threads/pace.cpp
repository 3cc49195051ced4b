#include "dashpot/threads/pace.hpp"

#include <algorithm>

namespace dashpot {

namespace {

// Fraction of the time by which the other way has to be faster: steps differ by as much.
constexpr double kGain = 0.03;
// Trials that change nothing come more and more seldom, until they take no more than 1 % of time;
// and soon again in another scene, whose steps take so many times as long or as short.
constexpr int kSeldom = 2048;
constexpr double kOtherScene = 2.0;

void take_least(double seconds, double& least) {
  least = least > 0.0 ? std::min(least, seconds) : seconds;
}

}  // namespace

void Pace::note(double seconds) {
  --left_;
  const bool compared = left_ < kCompared;
  switch (phase_) {
    case Phase::kUsual:
      if (compared) take_least(seconds, before_);
      note_usual(seconds);
      if (left_ > 0) return;
      phase_ = Phase::kTrial;
      break;
    case Phase::kTrial:
      if (compared) take_least(seconds, trial_);
      if (left_ > 0) return;
      phase_ = Phase::kAfter;
      break;
    case Phase::kAfter:
      if (compared) take_least(seconds, after_);
      if (left_ > 0) return;
      return decide();
  }
  left_ = kUnfit + kCompared;
}

void Pace::note_usual(double seconds) {
  const bool other = seconds > kOtherScene * usual_ || seconds * kOtherScene < usual_;
  unusual_ = usual_ > 0.0 && other ? unusual_ + 1 : 0;
  if (unusual_ < kCompared) return;
  interval_ = kFirst;
  left_ = std::min(left_, kFirst);
  usual_ = 0.0;
}

void Pace::decide() {
  const bool other_is_faster = trial_ < (1.0 - kGain) * 0.5 * (before_ + after_);
  if (other_is_faster) shares_ = !shares_;
  usual_ = other_is_faster ? trial_ : after_;
  interval_ = other_is_faster ? kFirst : std::min(2 * interval_, kSeldom);
  phase_ = Phase::kUsual;
  left_ = interval_;
  before_ = trial_ = after_ = 0.0;
}

}  // namespace dashpot
