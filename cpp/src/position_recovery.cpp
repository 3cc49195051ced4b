#include "dashpot/position_recovery.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/row_products.hpp"

namespace dashpot {

double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement) {
  const auto jacobian = [&](const RowGroup& c) { return rows.jacobian.data() + c.jacobian; };
  double descent = 0.0;  // t' inv(W) t
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kBilateral || data.offset[index] == 0.0) continue;
    const double w = std::max(rows.inverse_mass[c.row], rows.typical_inverse_mass[c.row]);
    if (w == 0.0) continue;
    const double reach = recovery_speed * time;
    const double target = std::clamp(data.offset[index], -reach, reach);
    const double multiplier = target / w;
    scatter(jacobian(c), c, &multiplier, displacement.data());
    descent += target * multiplier;
    data.touched[index] = 1;
  }
  if (descent == 0.0) return 0.0;
  const auto for_each_dof = [&](const auto& function) {
    for (int tree : island.tree) {
      const Tree& t = trees.tree[tree];
      for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) function(i);
    }
  };
  double curvature = 0.0;  // d' H d at alpha = 1
  for_each_dof([&](int i) { curvature += displacement[i] * displacement[i]; });
  const double alpha = descent < curvature ? descent / curvature : 1.0;
  for_each_dof([&](int i) { displacement[i] *= alpha; });
  const double before = elastic_energy(rows, data).sum();
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (c.kind == RowKind::kBilateral) continue;
    double shift[kMaxRows] = {};
    gather(jacobian(c), c, displacement.data(), shift);
    for (int i = 0; i < c.dim; ++i) data.deformation[c.row + i] += shift[i];
  }
  return elastic_energy(rows, data).sum() - before;
}

}  // namespace dashpot
