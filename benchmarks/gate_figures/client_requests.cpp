// What a program under callgrind asks of it, for count_steps.py: `begin` sets counts to zero and
// counts from here on, `end` writes them, with a name, to a file of their own. instructions.py
// compiles it, as a shared library.

#include <valgrind/callgrind.h>

extern "C" {
void begin() {
  CALLGRIND_START_INSTRUMENTATION;  // what is counted already goes on
  CALLGRIND_ZERO_STATS;
}
void end(const char* name) { CALLGRIND_DUMP_STATS_AT(name); }
}
