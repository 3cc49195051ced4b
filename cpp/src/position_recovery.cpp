#include "dashpot/position_recovery.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement) {
  double descent = 0.0;         // t' inv(W) t
  std::vector<double> applied;  // J' inv(W) t
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kBilateral || data.offset[index] == 0.0) continue;
    const double w = std::max(rows.inverse_mass[c.row], rows.typical_inverse_mass[c.row]);
    if (w == 0.0) continue;
    const double reach = recovery_speed * time;
    const double target = std::clamp(data.offset[index], -reach, reach);
    const double multiplier = target / w;
    applied.resize(displacement.size(), 0.0);
    scatter(rows, c, &multiplier, applied.data());
    descent += target * multiplier;
    data.touched[index] = 1;
  }
  if (descent == 0.0) return 0.0;
  double curvature = 0.0;  // d' H d at alpha = 1
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    add_response(trees, index, applied.data() + t.begin, displacement.data() + t.begin);
    for (int i = t.begin; i < t.begin + t.count; ++i) curvature += displacement[i] * applied[i];
  }
  const double alpha = descent < curvature ? descent / curvature : 1.0;
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) displacement[i] *= alpha;
  }
  const double before = elastic_energy(rows, data).sum();
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (c.kind == RowKind::kBilateral) continue;
    double shift[kMaxRows] = {};
    gather(rows, c, displacement.data(), shift);
    for (int i = 0; i < c.dim; ++i) data.deformation[c.row + i] += shift[i];
  }
  return elastic_energy(rows, data).sum() - before;
}

}  // namespace dashpot
