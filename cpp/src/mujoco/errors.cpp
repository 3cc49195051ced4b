#include "dashpot/mujoco/errors.hpp"

#include <mujoco/mujoco.h>

#include <csetjmp>
#include <cstring>
#include <string>

// Exported by the pinned MuJoCo library though not declared in its public headers: the log handler
// of the present thread, which MuJoCo's Python package itself sets around its calls (it returns the
// one before), and the handler of all threads.
extern "C" mjfLogHandler _mjPRIVATE_setTlsLogHandler(mjfLogHandler handler);
extern "C" mjfLogHandler _mjPRIVATE_getGlobalLogHandler(void);

namespace dashpot::host {

namespace {

// Where the errors of a call go that may be called back from.
thread_local std::jmp_buf* landing = nullptr;
thread_local char error_of_call[sizeof mjLogMessage::subject];

bool starts_with(const char* text, const char* beginning) {
  return std::strncmp(text, beginning, std::strlen(beginning)) == 0;
}

[[noreturn]] void throw_error(const char* error) {
  if (starts_with(error, "mj_stackAlloc: out of memory"))
    throw StackOverflow(std::string("the step needs more than the memory of the model; enlarge "
                                    "<size memory=\"...\"/> (") +
                        error + ")");
  if (starts_with(error, "Python exception raised"))
    throw CallbackError("a Python callback of MuJoCo raised an exception");
  throw MujocoError(error);
}

void leave_at_errors(const mjLogMessage* message) {
  if (message->level != mjLOG_ERROR) return _mjPRIVATE_getGlobalLogHandler()(message);
  if (!landing) throw_error(message->subject);
  std::memcpy(error_of_call, message->subject, sizeof error_of_call);
  std::longjmp(*landing, 1);
}

}  // namespace

ErrorGuard::ErrorGuard(mjData_* d)
    : data_(d), outer_(_mjPRIVATE_setTlsLogHandler(leave_at_errors)) {
  if (!d) return;
  stack_ = d->pstack;
  frame_ = d->pbase;
}

ErrorGuard::~ErrorGuard() {
  _mjPRIVATE_setTlsLogHandler(outer_);
  if (!data_) return;
  data_->pstack = stack_;
  data_->pbase = frame_;
}

void call_with_callbacks(void (*function)(const mjModel_*, mjData_*), const mjModel_* m,
                         mjData_* d) {
  std::jmp_buf here;
  std::jmp_buf* const outer = landing;
  if (setjmp(here) != 0) {
    landing = outer;
    throw_error(error_of_call);
  }
  landing = &here;
  function(m, d);
  landing = outer;
}

}  // namespace dashpot::host
