// What Python threads that share an engine take while they step or copy its model.

#pragma once

#include <mutex>

namespace dashpot::bindings {

// A step changes the model for a while and restores it, so whoever steps or copies it has it alone.
// Threads get the lock in turn: one that steps in a loop does not keep the others out.
class ModelLock {
 public:
  void lock() {
    const std::lock_guard<std::mutex> first_in_line(next_);
    held_.lock();
  }
  void unlock() { held_.unlock(); }

 private:
  std::mutex next_, held_;
};

}  // namespace dashpot::bindings
