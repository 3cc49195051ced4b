// Which data a step takes.

#pragma once

struct mjModel_;
struct mjData_;

namespace dashpot::host {

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

}  // namespace dashpot::host
