#include "without_gil.hpp"

#include <pthread.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

namespace dashpot::bindings {

namespace {

std::atomic<int> calls = 0;    // that run without the GIL
std::atomic<int> at_rest = 0;  // of these, that will not ask for the GIL before they look again
std::atomic<bool> exits = false;
std::atomic<std::thread::id> exiting_thread;
std::atomic<bool> others_call = false;  // threads that are not the one that imported this
const std::thread::id importing_thread = std::this_thread::get_id();
thread_local int own_calls = 0;

// Long enough for a thread between two calls, in Python or in MuJoCo, to come to its next one.
constexpr std::chrono::milliseconds kGrace{50};
// A call that waits in a callback for what never comes does not keep the interpreter from ending.
constexpr std::chrono::seconds kPatience{10};

// A call that finds the interpreter at its end stays here for ever.
void stand_still_at_exit() {
  if (!exits || exiting_thread.load() == std::this_thread::get_id()) return;
  ++at_rest;
  while (true) std::this_thread::sleep_for(std::chrono::hours(1));
}

// Of the threads of a process only that which forks it goes on in the child.
void forget_other_threads() {
  calls = own_calls;
  at_rest = 0;
}

[[maybe_unused]] const int registered = pthread_atfork(nullptr, nullptr, forget_other_threads);

}  // namespace

WithoutGil::WithoutGil() {
  ++calls;
  ++own_calls;
  if (std::this_thread::get_id() != importing_thread) others_call = true;
  released_.emplace();
  stand_still_at_exit();
}

WithoutGil::~WithoutGil() {
  stand_still_at_exit();
  released_.reset();
  --own_calls;
  --calls;
}

WaitWithoutGil::WaitWithoutGil() { ++at_rest; }

WaitWithoutGil::~WaitWithoutGil() {
  --at_rest;
  stand_still_at_exit();
}

void handle_signals() {
  // Ends the threads that share the call; WithoutGil holds what unwinds.
  if (exits && exiting_thread.load() != std::this_thread::get_id())
    throw std::runtime_error("the interpreter ends");
  const pybind11::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) throw pybind11::error_already_set();
}

void stop_at_exit() {
  const pybind11::gil_scoped_release release;
  exiting_thread = std::this_thread::get_id();
  exits = true;
  if (others_call) std::this_thread::sleep_for(kGrace);
  const auto latest = std::chrono::steady_clock::now() + kPatience;
  while (calls > at_rest && std::chrono::steady_clock::now() < latest)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

}  // namespace dashpot::bindings
