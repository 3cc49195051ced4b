// Passes shared by threads: every item is visited once, by whatever thread; what passes throw
// arrives; threads that sleep wake up. Run under a thread sanitizer it finds races of the team.

#include <atomic>
#include <cfenv>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "checks.hpp"
#include "dashpot/threads/pace.hpp"
#include "dashpot/threads/team.hpp"

namespace {

using namespace dashpot;

// A pass writes without any lock: one that is not over when share() returns shows in the next.
void check_every_item_once(Team& team, int count, int grain) {
  std::vector<int> visits(count, 0);
  bool once = true;
  std::atomic<bool> fits{true};
  team.share(count, grain, [&](int worker, int first, int last) {
    if (worker < 0 || worker >= team.size() || first < 0 || last > count) fits = false;
    for (int item = first; item < last; ++item) ++visits[item];
  });
  for (int of_item : visits) once = once && of_item == 1;
  check(once, "every item is visited once");
  check(fits, "workers and ranges are those of the team and the pass");
}

void check_exception(Team& team) {
  std::string what;
  try {
    team.for_each(1000, 10, [](int item) {
      if (item % 100 == 57) throw std::runtime_error(std::to_string(item));
    });
  } catch (const std::runtime_error& error) {
    what = error.what();
  }
  check(what == "57", "the exception of the lowest range arrives");
  check_every_item_once(team, 1000, 10);
}

// The passes of a step depend on each other: each sees what the one before wrote.
void check_passes_in_turn(Team& team) {
  std::vector<int> values(300, 0), sums(300, 0);
  for (int pass = 1; pass <= 20000; ++pass) {
    team.for_each(300, 20, [&](int i) { values[i] = pass + sums[299 - i]; });
    team.for_each(300, 20, [&](int i) { sums[i] = values[299 - i] % 1000; });
  }
  std::vector<int> expected_values(300, 0), expected(300, 0);
  for (int pass = 1; pass <= 20000; ++pass) {
    for (int i = 0; i < 300; ++i) expected_values[i] = pass + expected[299 - i];
    for (int i = 0; i < 300; ++i) expected[i] = expected_values[299 - i] % 1000;
  }
  check(sums == expected, "a pass sees what the one before wrote");
}

// Other threads round as the calling one does at the time, and take subnormal numbers as it does.
void check_rounding(Team& team) {
  const volatile double one = 1.0, three = 3.0;
  for (int mode : {FE_UPWARD, FE_DOWNWARD, FE_TONEAREST}) {
    std::fesetround(mode);
    const double expected = one / three;
    std::vector<double> found(1000);
    for (int pass = 0; pass < 100; ++pass) {
      team.for_each(1000, 10, [&](int i) { found[i] = one / three; });
      for (double of_item : found) check(of_item == expected, "all threads round alike");
    }
  }
}

// More threads than cores: the system stops them anywhere, for as long as it likes.
void check_crowd() {
  std::vector<std::thread> callers;
  std::atomic<int> wrong{0};
  for (int caller = 0; caller < 3; ++caller)
    callers.emplace_back([&] {
      Team team(4);
      team.begin(true);
      std::vector<int> values(64, 0);
      for (int pass = 1; pass <= 4000; ++pass) {
        team.for_each(64, 4, [&](int i) { values[i] += i % 5 == pass % 5 ? 2 : 1; });
        if (pass % 1000 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      for (int value : values) wrong += value != 4000 + 800;
    });
  for (std::thread& caller : callers) caller.join();
  check(wrong == 0, "threads that the system stops miss nothing and do nothing twice");
}

// Of 1000 steps that take these times, after 4000 others, how many are shared.
int shared_steps(Pace& pace, double shared, double alone) {
  int count = 0;
  for (int step = 0; step < 5000; ++step) {
    count += step >= 4000 && pace.shares();
    pace.note(pace.shares() ? shared : alone);
  }
  return count;
}

// Trials take five steps, seldom where they change nothing; ways that differ by rounding stay.
void check_pace() {
  Pace pace;
  check(pace.shares(), "the first step is shared");
  check(shared_steps(pace, 1.0, 1.5) >= 995, "steps that threads make faster are shared");
  check(shared_steps(pace, 1.5, 1.0) <= 5, "steps that threads make slower are not");
  check(shared_steps(pace, 1.0, 1.5) >= 995, "what has changed is found out");
  check(shared_steps(pace, 1.0, 0.99) >= 995, "what is as fast stays");
  // Steps that take less and less time, as those of a heap that settles.
  double seconds = 1.0;
  int changes = 0;
  for (int step = 0; step < 400; ++step, seconds *= 0.99) {
    pace.note(seconds);
    changes += !pace.shares();
  }
  check(changes <= 15, "what falls whichever way does not change it");
  // A small scene that grows.
  Pace grown;
  shared_steps(grown, 0.011, 0.010);
  check(!grown.shares(), "a small scene is not shared");
  int alone = 0;
  for (int step = 0; step < 500; ++step) {
    alone += !grown.shares();
    grown.note(grown.shares() ? 0.6 : 1.0);
  }
  check(alone < 100, "soon after it has grown it is");
}

}  // namespace

int main() {
  check_pace();
  check_crowd();
  for (int threads : {1, 2, 3, 8}) {
    Team team(threads);
    team.begin(true);
    check(team.size() >= 1 && team.size() <= threads, "a team has no more threads than asked for");
    for (int count : {0, 1, 7, 64, 1000})
      for (int grain : {1, 10, 64}) check_every_item_once(team, count, grain);
    check_exception(team);
    check_passes_in_turn(team);
    check_rounding(team);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // they sleep by now
    check_every_item_once(team, 1000, 10);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    team.begin(true);
    check_every_item_once(team, 1000, 10);
    team.begin(false);
    const std::thread::id own = std::this_thread::get_id();
    team.for_each(1000, 10, [&](int) {
      check(std::this_thread::get_id() == own, "a pass that is not shared stays with its thread");
    });
  }
  return exit_status();
}
