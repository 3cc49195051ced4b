// MuJoCo's stack overflow as an exception. Part of the mujoco_host room.
//
// MuJoCo ends the process where a computation finds no room on the stack in mjData. Here that is
// thrown through the frames between: those of MuJoCo's engine, written in C, which hold nothing but
// that stack, in a library with unwind tables. Its other fatal errors end the process as they do by
// default: exceptions cannot pass through the callbacks of its Python package, which carry a C++
// runtime of their own.

#pragma once

#include <cstddef>
#include <stdexcept>

struct mjData_;
struct mjLogMessage_;

namespace dashpot::host {

struct StackOverflow : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// While it lives, a stack overflow in this thread throws StackOverflow. At its end the stack of `d`
// is as it was.
class StackGuard {
 public:
  explicit StackGuard(mjData_* d);
  ~StackGuard();
  StackGuard(const StackGuard&) = delete;
  StackGuard& operator=(const StackGuard&) = delete;

 private:
  using Handler = void (*)(const mjLogMessage_*);
  mjData_* data_;
  std::size_t stack_, frame_;
  Handler outer_;
};

}  // namespace dashpot::host
