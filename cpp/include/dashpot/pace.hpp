// Whether it pays that threads share steps, found by trying.
//
// What a pass costs beside its work depends on the machine: cache lines go from core to core of one
// processor in 0.05 us, from one socket to another in 0.3 us, and a thread that shares its core with
// another program comes late. In small scenes, or there, steps are faster on one thread. So now and
// then some steps are taken the other way, and the faster way stays. Results are the same.

#pragma once

namespace dashpot {

class Pace {
 public:
  // Whether the next step is to be shared.
  bool shares() const { return shares_ != trying(); }
  // That step took `seconds`.
  void note(double seconds);

 private:
  bool trying() const { return left_ <= 0; }

  bool shares_ = true;
  int left_ = kFirst;      // steps until the next trial; of a trial, less the steps it has taken
  int interval_ = kFirst;  // between trials, steps
  double least_ = 0.0;     // s, of the last steps before a trial; 0: none yet
  double trial_ = 0.0;     // s, of a trial

  // Steps before the first trial; of trials, and before them, that are compared; and in a trial
  // before them, in which threads wake up and caches change hands.
  static constexpr int kFirst = 64, kCompared = 3, kUnfit = 2;
};

}  // namespace dashpot
