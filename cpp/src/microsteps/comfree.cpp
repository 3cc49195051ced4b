#include "dashpot/microsteps/comfree.hpp"

#include <algorithm>

namespace dashpot {

namespace {

constexpr double kMinimumValue = 1e-15;  // MuJoCo's mjMINVAL

}  // namespace

double effective_mass(double impedance, double inverse_mass) {
  return 1.0 / std::max(kMinimumValue, inverse_mass * (1.0 - impedance) / impedance);
}

void facet_forces(const ComFree& law, double mass, double gap, const double* predicted_rate,
                  const double* friction, int dim, double step, double* force) {
  const double stiffness = law.stiffness / step, damping = law.damping / step;
  const auto facet = [&](double rate) {
    return std::max(0.0, mass * (-damping * rate - stiffness * (gap + step * rate)));
  };
  if (dim == 1) {
    force[0] = facet(predicted_rate[0]);
    return;
  }
  force[0] = 0.0;
  for (int i = 1; i < dim; ++i) {
    const double mu = friction[i - 1];
    const double plus = facet(predicted_rate[0] + mu * predicted_rate[i]);
    const double minus = facet(predicted_rate[0] - mu * predicted_rate[i]);
    force[0] += plus + minus;
    force[i] = mu * (plus - minus);
  }
}

void update_complementarity_free(const ComFree& law, const Rows& rows, const Trees& trees,
                                 const std::vector<double>& gap, const std::vector<double>& mass,
                                 double step, RowData& data) {
  for (const RowGroup& c : rows.group)
    gather(rows, c, data.velocity.data(), data.rate.data() + c.row);
  for (size_t i = 0; i < data.velocity.size(); ++i)
    data.velocity[i] += step * data.smooth_acceleration[i];

  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (gap[index] >= 0.0) continue;
    double predicted_rate[kMaxRows], force[kMaxRows];
    gather(rows, c, data.velocity.data(), predicted_rate);
    facet_forces(law, mass[index], gap[index], predicted_rate, rows.friction.data() + c.row + 1,
                 c.dim, step, force);
    data.touched[index] = force[0] > 0.0;
    for (int i = 0; i < c.dim; ++i) data.total_impulse[c.row + i] = step * force[i];
    scatter(rows, c, data.total_impulse.data() + c.row, data.coordinate_impulse.data());
  }
  for (size_t tree = 0; tree < trees.tree.size(); ++tree) {
    const int begin = trees.tree[tree].begin;
    add_response(trees, static_cast<int>(tree), data.coordinate_impulse.data() + begin,
                 data.velocity.data() + begin);
  }

  for (const RowGroup& c : rows.group) {
    double rate[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    for (int i = 0; i < c.dim; ++i) {
      share(data.work, c, i) +=
          0.5 * data.total_impulse[c.row + i] * (data.rate[c.row + i] + rate[i]);
      data.rate[c.row + i] = rate[i];
    }
  }
}

}  // namespace dashpot
