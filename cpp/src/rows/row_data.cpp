#include "dashpot/rows/row_data.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

// Groups that are summed up one by one: sums over ranges of them do not depend on threads.
constexpr int kGroupsOfSum = 128;
// Gap rate, in parts of omega x, from which on a compressed spring swings rather than rests. With
// 0.1 overlap recovered where hits turn, and one of a cylinder on a rod gained 7 %.
constexpr double kSwinging = 0.01;

// Whether the spring of a contact swings, or what comes will have it swing, with a force of more
// than kHitLoads times the load of smooth forces.
bool is_hit_on(const Rows& rows, const RowData& data, const RowGroup& c) {
  if (c.kind != RowKind::kContact) return false;
  const double rate = first_rate(rows, c, data.velocity);
  const double load = first_rate(rows, c, data.smooth_acceleration);
  const double square = rows.stiffness[c.row] * rows.inverse_mass[c.row];  // omega^2
  const double x = data.deformation[c.row], coming = std::min(rate, 0.0);
  const double swing = square * (square * x * x + coming * coming);
  return swing > kHitLoads * kHitLoads * load * load &&
         rate * rate > kSwinging * kSwinging * square * x * x;
}

void add_elastic_energy(const Rows& rows, const RowData& data, int index, EnergyShares& energy) {
  const RowGroup& c = rows.group[index];
  if (c.is_unilateral() && data.deformation[c.row] >= 0.0) return;
  share(energy, c, 0) += data.beyond[index];
  for (int i = 0; i < c.dim; ++i) {
    const double x = data.deformation[c.row + i];
    share(energy, c, i) += 0.5 * rows.stiffness[c.row + i] * x * x;
  }
}

}  // namespace

double& share(EnergyShares& shares, const RowGroup& c, int i) {
  if (c.kind != RowKind::kContact) return c.is_damper ? shares.damping : shares.constraint;
  return i == 0 ? shares.normal : shares.friction;
}

void RowData::reset_motion(int coordinates) {
  for (auto* array : {&velocity, &smooth_acceleration, &total_displacement, &coordinate_impulse,
                      &braked, &pulled, &added_acceleration})
    array->assign(coordinates, 0.0);
  velocity[kSurfaceCoordinate] = 1.0;
  smooth_acceleration[kTurningCoordinate] = 1.0;
}

void RowData::reset_rows(const Rows& rows) {
  for (auto* array : {&deformation, &rate, &total_impulse})
    array->assign(rows.inverse_mass.size(), 0.0);
  for (auto* array : {&unstressed, &energy_tank, &beyond, &force_moment, &turning_work,
                      &acceleration_work, &drift})
    array->assign(rows.group.size(), 0.0);
  sticking.assign(rows.group.size(), 1);
  for (auto* array : {&touched, &is_of_isolated_pair}) array->assign(rows.group.size(), 0);
  hit.assign(rows.group.size(), Hit::kNone);
  work = recovery_input = EnergyShares{};
}

double recovery_speed_of(const Rows& rows, const RowData& data, int index, double recovery_speed) {
  const RowGroup& c = rows.group[index];
  const bool waits = c.soft_load > 0.0 && c.solref.load == 0.0 && data.unstressed[index] > 0.0 &&
                     !std::isinf(recovery_speed) && is_hit_on(rows, data, c);
  return waits ? 0.0 : recovery_speed_along(rows, c, recovery_speed);
}

double bearable_of(const Rows& rows, const RowData& data, const RowGroup& c,
                   double recovery_speed) {
  const double bearable = bearable_compression(rows, c, recovery_speed);
  const double kappa = rows.stiffness[c.row] * rows.inverse_mass[c.row];
  if (c.kind != RowKind::kUnilateral || kappa == 0.0) return bearable;
  const double load = first_rate(rows, c, data.smooth_acceleration);
  return bearable + 2.0 * std::max(0.0, -load) / kappa;
}

double elastic_energy(const Rows& rows, const RowData& data, const std::vector<int>& groups) {
  EnergyShares energy;
  for (int index : groups) add_elastic_energy(rows, data, index, energy);
  return energy.sum();
}

EnergyShares elastic_energy(const Rows& rows, const RowData& data, Team& team) {
  const int count = static_cast<int>(rows.group.size());
  thread_local std::vector<EnergyShares> kept;  // by the thread: no allocation in a step
  std::vector<EnergyShares>& of_range = kept;
  of_range.resize((count + kGroupsOfSum - 1) / kGroupsOfSum);
  team.for_each(static_cast<int>(of_range.size()), 1, [&](int range) {
    EnergyShares energy;
    const int first = range * kGroupsOfSum, last = std::min(count, first + kGroupsOfSum);
    for (int index = first; index < last; ++index) add_elastic_energy(rows, data, index, energy);
    of_range[range] = energy;
  });
  EnergyShares energy;
  for (const EnergyShares& term : of_range) energy += term;
  return energy;
}

void book_rows(const RowData& data, const EnergyShares& before, const EnergyShares& after,
               EnergyLedger& ledger) {
  ledger.dissipated_recovery += ledger.elastic - before.sum() - data.recovery_input.sum();
  ledger.dissipated_normal +=
      data.recovery_input.normal - data.work.normal - (after.normal - before.normal);
  ledger.dissipated_friction -= data.work.friction + (after.friction - before.friction);
  ledger.dissipated_constraint += data.recovery_input.constraint - data.work.constraint -
                                  (after.constraint - before.constraint);
  ledger.dissipated_damping -= data.work.damping;
  ledger.elastic = after.sum();
}

}  // namespace dashpot
