// What the tests check by: a claim that fails is printed, and fails the program.

#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>

inline int failures = 0;
inline constexpr int kMostPrinted = 20;  // of claims that many cases may fail

inline void check(bool passed, const char* claim) {
  if (passed) return;
  if (++failures <= kMostPrinted) std::printf("failed: %s\n", claim);
}

inline void check(bool passed, const char* claim, double got, double expected) {
  if (passed) return;
  if (++failures <= kMostPrinted)
    std::printf("failed: %s: %.17g against %.17g\n", claim, got, expected);
}

inline void check_close(double got, double expected, double scale, double tolerance,
                        const char* claim) {
  check(std::fabs(got - expected) <= tolerance * scale, claim, got, expected);
}

// What main() returns.
inline int exit_status() {
  if (failures > 0) std::printf("%d checks failed\n", failures);
  return failures > 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
