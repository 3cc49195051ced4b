#include "dashpot/model/errors.hpp"

#include <mujoco/mujoco.h>

#include <csetjmp>
#include <cstring>

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

std::string named(const mjModel_* m, int type, int id) {
  const char* name = mj_id2name(m, type, id);
  return name && *name ? "'" + std::string(name) + "'" : "#" + std::to_string(id);
}

std::string contact_side(const mjModel_* m, int geom) {
  return geom < 0 ? "flex " + named(m, mjOBJ_FLEX, -1 - geom)
                  : "geom " + named(m, mjOBJ_GEOM, geom);
}

std::string constraint_name(const mjModel_* m, const mjData_* d, int row) {
  const int id = d->efc_id[row];
  switch (d->efc_type[row]) {
    case mjCNSTR_EQUALITY:
      return "equality " + named(m, mjOBJ_EQUALITY, id);
    case mjCNSTR_FRICTION_DOF:
      return "dry friction of joint " + named(m, mjOBJ_JOINT, m->dof_jntid[id]);
    case mjCNSTR_FRICTION_TENDON:
      return "dry friction of tendon " + named(m, mjOBJ_TENDON, id);
    case mjCNSTR_LIMIT_JOINT:
      return "limit of joint " + named(m, mjOBJ_JOINT, id);
    default:
      return "limit of tendon " + named(m, mjOBJ_TENDON, id);
  }
}

}  // namespace dashpot::host
