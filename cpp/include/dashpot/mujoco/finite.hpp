// Whether numbers are finite, or within a bound, in one pass without branches: fast enough for all
// values of a model in every step.

#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace dashpot {

// The bits of all values that say what is wrong with them, in the sign: what is not finite has all
// bits of its exponent set, so that 1 more carries into it.
template <bool kSigned>
inline bool any_marked(const double* values, std::ptrdiff_t count) {
  static_assert(sizeof(double) == sizeof(std::uint64_t));
  constexpr std::uint64_t kExponent = 0x7ff0000000000000, kOne = 0x0010000000000000;
  std::uint64_t marks = 0;
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    std::uint64_t bits;
    std::memcpy(&bits, values + i, sizeof bits);
    marks |= (bits & kExponent) + kOne;
    if constexpr (kSigned) marks |= bits;
  }
  return marks >> 63;
}

inline bool are_finite(const double* values, std::ptrdiff_t count) {
  return !any_marked<false>(values, count);
}

// False for -0, too: whoever asks looks closer then.
inline bool are_finite_and_not_negative(const double* values, std::ptrdiff_t count) {
  return !any_marked<true>(values, count);
}

// Whether no value is beyond a bound > 0, or no number.
inline bool are_within(const double* values, std::ptrdiff_t count, double bound) {
  constexpr std::uint64_t kMagnitude = 0x7fffffffffffffff;
  std::uint64_t most, marks = 0;
  std::memcpy(&most, &bound, sizeof most);
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    std::uint64_t bits;
    std::memcpy(&bits, values + i, sizeof bits);
    marks |= (bits & kMagnitude) + (kMagnitude - most);  // magnitudes are ordered as their bits
  }
  return !(marks >> 63);
}

}  // namespace dashpot
