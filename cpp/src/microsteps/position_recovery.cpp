#include "dashpot/microsteps/position_recovery.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands/islands.hpp"
#include "dashpot/microsteps/recovery_system.hpp"

namespace dashpot {

double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement) {
  if (std::none_of(island.group.begin(), island.group.end(), [&](int index) {
        return rows.group[index].kind == RowKind::kBilateral && data.offset[index] != 0.0;
      }))
    return 0.0;
  thread_local RecoverySystem system;  // kept by the thread: no allocation in a step
  system.reset(rows, trees, island, recovery_speed * time, time, data);
  if (system.empty()) return 0.0;
  system.solve(displacement);
  const std::vector<double>& shift = system.shift();

  // What all springs follow, beyond what equalities recover.
  double strain_energy = 0.0;
  const auto beyond = [&](size_t i, double part) {
    const double target = system.target()[i], along = part * shift[i];
    return along - std::clamp(along, std::min(0.0, target), std::max(0.0, target));
  };
  const auto for_each_row = [&](const auto& function) {
    size_t i = 0;
    for (int index : system.groups()) {
      const RowGroup& c = rows.group[index];
      for (int row = c.row; row < c.row + c.dim; ++row) function(row, i++);
    }
  };
  for_each_row([&](int row, size_t i) {
    strain_energy += 0.5 * rows.stiffness[row] * std::pow(beyond(i, 1.0), 2);
  });
  // The strain may hold no more energy than bodies that move so far in this step, which leaves
  // less than the whole displacement where the iteration has not converged.
  const double allowed = 0.5 * std::max(0.0, system.square()) / (time * time);
  const double part = strain_energy > allowed ? std::sqrt(allowed / strain_energy) : 1.0;
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) displacement[i] *= part;
  }

  const double before = elastic_energy(rows, data, system.groups());
  for_each_row([&](int row, size_t i) { data.deformation[row] += beyond(i, part); });
  for (int index : system.groups())
    if (rows.group[index].kind == RowKind::kBilateral) data.touched[index] = 1;
  return elastic_energy(rows, data, system.groups()) - before;
}

}  // namespace dashpot
