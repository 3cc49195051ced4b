#include "dashpot/row_data.hpp"

#include <algorithm>
#include <vector>

#include "dashpot/islands.hpp"

namespace dashpot {

namespace {

// Groups that are summed up one by one: sums over ranges of them do not depend on threads.
constexpr int kGroupsOfSum = 128;

}  // namespace

double& share(EnergyShares& shares, const RowGroup& c, int i) {
  if (c.kind != RowKind::kContact) return shares.constraint;
  return i == 0 ? shares.normal : shares.friction;
}

void RowData::reset_motion(int coordinates) {
  for (auto* array : {&velocity, &smooth_acceleration, &total_displacement, &coordinate_impulse,
                      &shift, &braked, &added_acceleration})
    array->assign(coordinates, 0.0);
  velocity[kSurfaceCoordinate] = 1.0;
  smooth_acceleration[kTurningCoordinate] = 1.0;
}

void RowData::reset_rows(const Rows& rows) {
  for (auto* array : {&deformation, &rate, &total_impulse})
    array->assign(rows.inverse_mass.size(), 0.0);
  offset.assign(rows.group.size(), 0.0);
  credit.assign(rows.group.size(), 0.0);
  force_moment.assign(rows.group.size(), 0.0);
  turning_work.assign(rows.group.size(), 0.0);
  sticking.assign(rows.group.size(), 1);
  for (auto* array : {&touched, &hit, &is_of_lone_pair}) array->assign(rows.group.size(), 0);
  work = recovery_input = EnergyShares{};
}

bool overlaps_semi_implicitly(const Rows& rows, const RowGroup& c, double gap,
                              const double* velocity, const double* acceleration, double time) {
  if (!c.is_unilateral() || gap <= 0.0) return false;
  double rate[kMaxRows], load[kMaxRows];
  gather(rows, c, velocity, rate);
  gather(rows, c, acceleration, load);
  return gap + time * (rate[0] + time * load[0]) <= 0.0;
}

bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data) {
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (!c.is_unilateral() || data.deformation[c.row] <= 0.0) return false;
  }
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double gap = data.deformation[c.row];
    double rate[kMaxRows], load[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    gather(rows, c, data.smooth_acceleration.data(), load);
    // The parabola's least value within the time: at an end, or where it turns.
    const double end = gap + time * (rate[0] + 0.5 * load[0] * time);
    const bool turns = rate[0] < 0.0 && rate[0] + load[0] * time > 0.0;
    const double least = turns ? gap - 0.5 * rate[0] * rate[0] / load[0] : end;
    if (least <= 0.0) return false;
    double shift[kMaxRows];
    gather(rows, c, data.shift.data(), shift);
    if (gap - shift[0] + time * (rate[0] + time * load[0]) <= 0.0) return false;
  }
  return true;
}

EnergyShares elastic_energy(const Rows& rows, const RowData& data, Team& team) {
  const int count = static_cast<int>(rows.group.size());
  thread_local std::vector<EnergyShares> kept;  // by the thread: no allocation in a step
  std::vector<EnergyShares>& of_range = kept;
  of_range.resize((count + kGroupsOfSum - 1) / kGroupsOfSum);
  team.for_each(static_cast<int>(of_range.size()), 1, [&](int range) {
    EnergyShares energy;
    const int first = range * kGroupsOfSum, last = std::min(count, first + kGroupsOfSum);
    for (int index = first; index < last; ++index) {
      const RowGroup& c = rows.group[index];
      if (c.is_unilateral() && data.deformation[c.row] >= 0.0) continue;
      for (int i = 0; i < c.dim; ++i) {
        const double x = data.deformation[c.row + i];
        share(energy, c, i) += 0.5 * rows.stiffness[c.row + i] * x * x;
      }
    }
    of_range[range] = energy;
  });
  EnergyShares energy;
  for (const EnergyShares& term : of_range) energy += term;
  return energy;
}

}  // namespace dashpot
