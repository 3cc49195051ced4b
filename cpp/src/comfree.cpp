#include "dashpot/comfree.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

// MuJoCo's mjMINIMP, mjMAXIMP and mjMINVAL.
constexpr double kMinimumImpedance = 1e-4;
constexpr double kMaximumImpedance = 0.9999;
constexpr double kMinimumValue = 1e-15;

double clip_impedance(double value) {
  return std::clamp(value, kMinimumImpedance, kMaximumImpedance);
}

}  // namespace

double impedance(const std::array<double, 5>& solimp, double gap) {
  const double start = clip_impedance(solimp[0]);
  const double end = clip_impedance(solimp[1]);
  const double width = solimp[2];
  const double midpoint = clip_impedance(solimp[3]);
  const double power = std::max(1.0, solimp[4]);
  if (width <= kMinimumValue) return 0.5 * (start + end);
  const double x = std::abs(gap) / width;
  if (x >= 1.0) return end;
  const double y = x <= midpoint
                       ? std::pow(x, power) / std::pow(midpoint, power - 1.0)
                       : 1.0 - std::pow(1.0 - x, power) / std::pow(1.0 - midpoint, power - 1.0);
  return start + y * (end - start);
}

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
