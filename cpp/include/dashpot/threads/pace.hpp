// Whether it pays that threads share steps, found by trying.
//
// What a pass costs beside its work depends on the machine: cache lines go from core to core of one
// processor in 0.05 us, from one socket to another in 0.3 us, and a thread that shares its core
// with another program comes late. In small scenes, or there, steps are faster on one thread. So
// now and then some steps are taken the other way, and where they are faster than those before and
// after, that way stays. Results are the same.

#pragma once

namespace dashpot {

class Pace {
 public:
  // Whether the next step is to be shared.
  bool shares() const { return shares_ != (phase_ == Phase::kTrial); }
  // Notes that this step took `seconds`.
  void note(double seconds);

 private:
  enum class Phase { kUsual, kTrial, kAfter };
  // Steps before the first trial, and of a phase those that are compared, after those in which
  // threads wake up and caches change hands.
  static constexpr int kFirst = 64, kCompared = 3, kUnfit = 2;

  void note_usual(double seconds);
  void decide();

  Phase phase_ = Phase::kUsual;
  bool shares_ = true;
  int left_ = kFirst;      // of the phase, steps
  int interval_ = kFirst;  // between trials, steps
  int unusual_ = 0;        // steps in a row whose time has little to do with that of the last trial
  double usual_ = 0.0;     // s, of the faster way then; 0: none yet
  double before_ = 0.0, trial_ = 0.0, after_ = 0.0;  // s, least of those compared; 0: none yet
};

}  // namespace dashpot
