// Calls without Python's GIL: its signals, as of Ctrl-C, and the end of the interpreter.
//
// A thread that asks for the GIL while the interpreter ends is ended by Python, which no C++
// destructor survives: the process aborts. Daemon threads can be in a call then. So the interpreter
// waits, before it ends, until each of them stands still or has returned from its call.

#pragma once

#include <pybind11/pybind11.h>

#include <optional>

namespace dashpot::bindings {

// Releases the GIL while it lives.
class WithoutGil {
 public:
  WithoutGil();
  ~WithoutGil();
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

 private:
  std::optional<pybind11::gil_scoped_release> released_;
};

// A wait for another thread, without the GIL: the end of the interpreter does not wait for it.
class WaitWithoutGil {
 public:
  WaitWithoutGil();
  ~WaitWithoutGil();
  WaitWithoutGil(const WaitWithoutGil&) = delete;
  WaitWithoutGil& operator=(const WaitWithoutGil&) = delete;
};

// Lets Python handle what signals have come; throws what a handler raises. Without the GIL, in the
// thread that Python called.
void handle_signals();

// Called by Python at its exit: returns when no other thread can ask for the GIL any more, or after
// ten seconds.
void stop_at_exit();

}  // namespace dashpot::bindings
