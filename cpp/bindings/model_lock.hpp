// What Python threads that share an engine take while they step or copy its model.

#pragma once

#include <atomic>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "without_gil.hpp"

namespace dashpot::bindings {

// A step changes the model for a while and restores it, so whoever steps or copies it has it alone.
// Threads get the lock in turn: one that steps in a loop does not keep the others out. Throws
// std::runtime_error in a thread that has it already.
class ModelLock {
 public:
  void lock() {
    if (owner_ == std::this_thread::get_id())
      throw std::runtime_error(
          "the engine is being stepped: what a step calls back cannot step, roll out or copy it; "
          "use a copy made before (copy.deepcopy)");
    {
      const WaitWithoutGil wait;
      const std::lock_guard<std::mutex> first_in_line(next_);
      held_.lock();
    }
    owner_ = std::this_thread::get_id();
  }
  void unlock() {
    owner_ = std::thread::id();
    held_.unlock();
  }
  // Before a fork: nobody is in line either, whose place the child would find taken for ever.
  void lock_with_line() {
    if (owner_ == std::this_thread::get_id()) throw std::runtime_error("the thread has the lock");
    const WaitWithoutGil wait;
    next_.lock();
    held_.lock();
  }
  void unlock_with_line() {
    held_.unlock();
    next_.unlock();
  }

 private:
  std::mutex next_, held_;
  std::atomic<std::thread::id> owner_ = std::thread::id();
};

}  // namespace dashpot::bindings
