// Whether a step takes a model and its data: sizes, finite numbers within bounds, and what edits
// between steps have changed.

#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

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

// Beyond this MuJoCo itself calls a position, velocity or acceleration diverged (mjMAXVAL).
inline constexpr double kLargestValue = 1e10;

// Size of the main buffer of data made for this model: tells foreign data apart.
long long data_size(const mjModel_* m);

// Whether all sizes of two models agree. This tells models apart where pickling has lost the
// signature of one of them or of its data: it is 0 then.
bool have_same_sizes(const mjModel_* a, const mjModel_* b);

// Throws std::invalid_argument if `d` was not made for `m` (whose data have `data_size`; of lost
// signatures the caller sees to have_same_sizes), or its state, controls or applied forces are not
// finite, or positions or velocities are beyond kLargestValue; names the field and the index.
void check_data(const mjModel_* m, const mjData_* d, long long data_size);

// Of what may be edited between steps. Throws std::invalid_argument that names the field, the value
// and whose it is: numbers and masses (check_numbers, check_masses), condim other than 1, 3, 4 or
// 6, geoms of a type that lacks what it is made of, a time step that is not positive, options of
// the medium that are not finite.
void check_values(const mjModel_* m);

// The same of the heights of fields, which are many.
void check_heights(const mjModel_* m);

// Throws std::invalid_argument that names the field, the value and the geom, pair, flex, body,
// joint, site, equality, tendon or actuator where one of what steps read of these is not finite (a
// range, or the margin of a limit: is no number), or is negative where it must not be (friction,
// sizes, armatures), or a solref that may act is of mixed format: one number positive, the other
// one not. Masses: check_masses. Not looked at: shapes of fluid, wrapping and meshes of flexes.
void check_numbers(const mjModel_* m);

// A copy of what edits may change of a model, so that a step checks it only after an edit.

// All options and arrays but those of meshes, textures, height fields, bounding volumes and names.
class KeptModel {
 public:
  // Whether `m` has every bit that it had when it was kept; false before.
  bool is_same(const mjModel_* m) const;
  void keep(const mjModel_* m);

 private:
  std::vector<char> copy_;
};

}  // namespace dashpot::host
