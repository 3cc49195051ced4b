#include "dashpot/parallel.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

namespace dashpot {

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

void parallel_for(int items, int threads, const std::function<void(int worker, int item)>& task) {
  std::atomic<int> next{0};
  std::atomic<int> first_failed{items};
  std::exception_ptr failure;
  std::mutex failure_mutex;

  const auto work = [&](int worker) {
    for (int item = next++; item < items; item = next++) {
      if (item > first_failed) continue;
      try {
        task(worker, item);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(failure_mutex);
        if (item < first_failed) {
          first_failed = item;
          failure = std::current_exception();
        }
      }
    }
  };

  std::vector<std::thread> others;
  try {
    for (int worker = 1; worker < threads; ++worker) others.emplace_back(work, worker);
  } catch (const std::system_error&) {
    // The system gives no more threads: those that there are do the work.
  }
  work(0);
  for (std::thread& thread : others) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace dashpot
