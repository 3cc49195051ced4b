// Independent items of work on threads.

#pragma once

#include <chrono>
#include <functional>

namespace dashpot {

// Number of threads to use for `items` items: `requested`, or the machine's when 0; never more
// than there are items. Throws std::invalid_argument where requested < 0.
int thread_count(int requested, int items);

// Asked by the thread that called for long work, every so often; throws to end the work.
using Interrupt = std::function<void()>;
constexpr std::chrono::milliseconds kInterruptInterval{50};

class Interruption;

// Whoever takes items.
class Worker {
 public:
  Worker(int index, Interruption& interruption) : index_(index), interruption_(interruption) {}

  int index() const { return index_; }

  // To be called in tasks that take long: ends this one where the work is to end, by an exception
  // that is no std::exception and that tasks let through.
  void look() const;

 private:
  int index_;
  Interruption& interruption_;
};

// Calls task(worker, item) for every item in [0, items), items handed out in order to `threads`
// workers (0 <= index < threads), or fewer where the system gives no more threads; with one thread
// everything runs on the calling thread. What a task writes must depend on its item alone, so that
// results do not depend on the thread count. Where tasks throw, the exception of the lowest item is
// rethrown after all threads have stopped; that of `interrupt` (may be empty) before any other.
void parallel_for(int items, int threads, const Interrupt& interrupt,
                  const std::function<void(const Worker& worker, int item)>& task);

}  // namespace dashpot
