// Signals of Python, as of Ctrl-C, in calls that take long without the GIL.

#pragma once

#include <pybind11/pybind11.h>

namespace dashpot::bindings {

// Lets Python handle what has come; throws what the handler raises. Without the GIL, in the thread
// that Python called.
inline void handle_signals() {
  const pybind11::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) throw pybind11::error_already_set();
}

}  // namespace dashpot::bindings
