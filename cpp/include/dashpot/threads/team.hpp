// Threads that share the passes of a step.
//
// A pass goes over many items, contacts or trees, that do not depend on each other; it takes some
// microseconds, too few to start or to wake a thread for. The threads of a team wait for the next
// pass in a loop, and sleep where none comes for some time. Each has an equal share of the items,
// the same in every pass over as many, so that they stay in its caches: shared first come first
// served, micro-steps took three times as long as on one thread. The calling thread has the first
// share; when it is done it takes over what others have not begun some microseconds later, so that
// a thread which the system does not run holds up nothing.
//
// What a pass computes must not depend on the number of threads: it writes to the places of its
// items alone, and what it sums up it sums up by items, not by threads.

#pragma once

#include <algorithm>
#include <memory>

namespace dashpot {

inline constexpr int kMostThreads = 128;  // as in MuJoCo

class Team {
 public:
  // `threads` from 1 to kMostThreads, the calling one among them; fewer where the system gives no
  // more. Throws std::invalid_argument where they are out of range.
  explicit Team(int threads);
  ~Team();
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  int size() const { return size_; }
  // Before passes that come soon: whether they are shared, or the calling thread does all, as it
  // does in a process that was forked off. Threads that sleep wake up.
  void begin(bool shares);
  // Threads that passes are shared by.
  int active() const { return shares_ ? size_ : 1; }

  // The size of the ranges that `count` items go into: of at most `grain`, all of a size but for
  // the last, and as many for each thread.
  int range_size(int count, int grain) const {
    const int ranges = std::max(1, (count + grain - 1) / grain);
    const int of_thread = (ranges + size_ - 1) / size_;
    return ranges == 1 ? std::max(1, count) : (count + of_thread * size_ - 1) / (of_thread * size_);
  }

  // Calls pass(worker, first, last) for ranges of range_size() items that cover [0, count), or once
  // for all of them where they are one range or one thread does all. `worker`: who does it, 0 for
  // the calling thread, less than size(). Of what passes throw, that of the lowest range is thrown
  // when all have ended. Passes are shared by one thread at a time, and not from within a pass.
  template <typename Pass>
  void share(int count, int grain, const Pass& pass) {
    if (count <= 0) return;
    if (size_ == 1 || !shares_ || count <= grain) return pass(0, 0, count);
    const Range range = [](const void* of, int worker, int first, int last) {
      (*static_cast<const Pass*>(of))(worker, first, last);
    };
    share_ranges({range, &pass, count, range_size(count, grain)});
  }

  // The same for each item, pass(item), where it does not matter who does it.
  template <typename Pass>
  void for_each(int count, int grain, const Pass& pass) {
    share(count, grain, [&](int, int first, int last) {
      for (int item = first; item < last; ++item) pass(item);
    });
  }

 private:
  using Range = void (*)(const void* pass, int worker, int first, int last);
  struct Job {
    Range range = nullptr;
    const void* pass = nullptr;
    int count = 0, grain = 1;
    int chunks() const { return (count + grain - 1) / grain; }
  };
  void share_ranges(const Job& job);

  struct Impl;
  int size_ = 1;
  bool shares_ = false;
  std::unique_ptr<Impl> impl_;  // null where there is one thread
};

}  // namespace dashpot
