#include "dashpot/mujoco_errors.hpp"

#include <mujoco/mujoco.h>

#include <cstring>
#include <string>

// Exported by the pinned MuJoCo library though not declared in its public headers: the log handler
// of the present thread, which MuJoCo's Python package itself sets around its calls (it returns the
// one before), and the handler of all threads.
extern "C" mjfLogHandler _mjPRIVATE_setTlsLogHandler(mjfLogHandler handler);
extern "C" mjfLogHandler _mjPRIVATE_getGlobalLogHandler(void);

namespace dashpot::host {

namespace {

constexpr char kOverflow[] = "mj_stackAlloc: out of memory";

void throw_overflow(const mjLogMessage* message) {
  if (message->level == mjLOG_ERROR &&
      std::strncmp(message->subject, kOverflow, sizeof kOverflow - 1) == 0)
    throw StackOverflow(std::string("the step needs more than the memory of the model; enlarge "
                                    "<size memory=\"...\"/> (") +
                        message->subject + ")");
  _mjPRIVATE_getGlobalLogHandler()(message);
}

}  // namespace

StackGuard::StackGuard(mjData_* d)
    : data_(d),
      stack_(d->pstack),
      frame_(d->pbase),
      outer_(_mjPRIVATE_setTlsLogHandler(throw_overflow)) {}

StackGuard::~StackGuard() {
  _mjPRIVATE_setTlsLogHandler(outer_);
  data_->pstack = stack_;
  data_->pbase = frame_;
}

}  // namespace dashpot::host
