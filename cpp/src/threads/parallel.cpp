#include "dashpot/threads/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace dashpot {

namespace {

struct Interrupted {};  // thrown through tasks

}  // namespace

class Interruption {
 public:
  explicit Interruption(const Interrupt& interrupt) : interrupt_(interrupt) {}

  // Worker 0 is the calling thread.
  void look(int worker) {
    if (worker == 0 && interrupt_ && !ended_) {
      const auto now = std::chrono::steady_clock::now();
      if (now - asked_ >= kInterruptInterval) {
        asked_ = now;
        ask();
      }
    }
    if (ended_) throw Interrupted();
  }

  // By the calling thread.
  void ask() {
    if (!interrupt_ || ended_) return;
    try {
      interrupt_();
    } catch (...) {
      reason_ = std::current_exception();
      ended_ = true;
    }
  }

  void rethrow() const {
    if (reason_) std::rethrow_exception(reason_);
  }

 private:
  const Interrupt& interrupt_;
  std::chrono::steady_clock::time_point asked_ = std::chrono::steady_clock::now();
  std::atomic<bool> ended_{false};
  std::exception_ptr reason_;  // of the calling thread
};

void Worker::look() const { interruption_.look(index_); }

int thread_count(int requested, int items) {
  if (requested < 0) {
    throw std::invalid_argument("nthread must be >= 0 (0: one per core), got " +
                                std::to_string(requested));
  }
  const int available = requested > 0
                            ? requested
                            : std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  return std::max(1, std::min(available, items));
}

void parallel_for(int items, int threads, const Interrupt& interrupt,
                  const std::function<void(const Worker& worker, int item)>& task) {
  Interruption interruption(interrupt);
  std::atomic<int> next{0};
  std::atomic<int> first_failed{items};
  std::exception_ptr failure;
  std::mutex mutex;  // of the failure and the number of threads at work
  std::condition_variable one_is_done;
  int at_work = 0;

  const auto work = [&](int index) {
    const Worker worker(index, interruption);
    for (int item = next++; item < items; item = next++) {
      if (item > first_failed) continue;
      try {
        worker.look();
        task(worker, item);
      } catch (const Interrupted&) {
        return;
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (item < first_failed) {
          first_failed = item;
          failure = std::current_exception();
        }
      }
    }
  };

  std::vector<std::thread> others;
  try {
    for (int index = 1; index < threads; ++index) {
      others.emplace_back([&, index] {
        work(index);
        const std::lock_guard<std::mutex> lock(mutex);
        --at_work;
        one_is_done.notify_one();
      });
      const std::lock_guard<std::mutex> lock(mutex);
      ++at_work;
    }
  } catch (const std::exception&) {
    // The system gives no more threads, or memory: those that there are do the work.
  }
  work(0);
  {
    std::unique_lock<std::mutex> lock(mutex);
    const auto all_are_done = [&] { return at_work == 0; };
    while (!one_is_done.wait_for(lock, kInterruptInterval, all_are_done)) {
      lock.unlock();
      interruption.ask();
      lock.lock();
    }
  }
  for (std::thread& thread : others) thread.join();
  interruption.rethrow();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace dashpot
