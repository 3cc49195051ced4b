// MuJoCo's fatal errors as exceptions, and how messages call its objects.
//
// MuJoCo ends the process where a computation finds no room on the stack in mjData, or where a
// callback of its Python package raises. Here both become exceptions. Through MuJoCo's engine they
// are thrown: it is written in C, holds nothing but that stack, and has unwind tables. They cannot
// be thrown through the callbacks of the Python package, which carry a C++ runtime of their own;
// calls from which there are callbacks are left by a jump, as that package itself leaves them.

#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

struct MujocoError : std::runtime_error {
  using std::runtime_error::runtime_error;
};
struct StackOverflow : MujocoError {
  using MujocoError::MujocoError;
};
// A Python callback raised; in the thread that called, the error indicator of Python is set.
struct CallbackError : MujocoError {
  using MujocoError::MujocoError;
};

// While it lives, errors of MuJoCo in this thread are thrown. At its end the stack of `d`, if there
// is one, is as it was.
class ErrorGuard {
 public:
  explicit ErrorGuard(mjData_* d = nullptr);
  ~ErrorGuard();
  ErrorGuard(const ErrorGuard&) = delete;
  ErrorGuard& operator=(const ErrorGuard&) = delete;

 private:
  using Handler = void (*)(const mjLogMessage_*);
  mjData_* data_;
  std::size_t stack_ = 0, frame_ = 0;
  Handler outer_;
};

// Calls a function of MuJoCo from which there may be callbacks, under an ErrorGuard.
void call_with_callbacks(void (*function)(const mjModel_*, mjData_*), const mjModel_* m,
                         mjData_* d);

// How messages call an object of MuJoCo's type `type`: its name in quotes, or # and its id.
std::string named(const mjModel_* m, int type, int id);
// The same for a side of a contact: a geom, or the flex -1 - geom.
std::string contact_side(const mjModel_* m, int geom);

// The joint, tendon or equality of a row of MuJoCo's constraints, as "limit of joint 'knee'".
std::string constraint_name(const mjModel_* m, const mjData_* d, int row);

}  // namespace dashpot::host
