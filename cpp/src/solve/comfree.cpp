#include "dashpot/solve/comfree.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

constexpr double kMinimumValue = 1e-15;  // MuJoCo's mjMINVAL
constexpr double kOfCoupling = 0.55;     // s of comfree.hpp

// f of a facet or of the row of an equality, before any bound.
double spring_damper(const ComFree& law, double mass, double gap, double rate, double step) {
  return mass * (-law.damping * rate - law.stiffness * (gap + step * rate)) / step;
}

// z = |inv(H)| y over the coordinates of one tree.
void add_magnitudes(const Trees& trees, const Tree& tree, const double* y, double* z) {
  const double* inverse = trees.inverse.data() + tree.inverse;
  const int first = tree.free_body ? 4 : 0, stride = tree.free_body ? 4 : tree.count;
  const int size = tree.free_body ? 3 : tree.dof_count;
  for (int i = 0; i < first; ++i) z[i] += inverse[i] * y[i];
  for (int j = 0; j < size; ++j)
    for (int i = 0; i < size && y[first + j] != 0.0; ++i)
      z[first + i] += std::abs(inverse[first + stride * j + i]) * y[first + j];
}

// S of comfree.hpp, by group.
void find_couplings(const Rows& rows, const Trees& trees, std::vector<double>& sums) {
  thread_local std::vector<double> sum_of_rows, response;
  sum_of_rows.assign(trees.coordinates, 0.0);
  response.assign(trees.coordinates, 0.0);
  sums.assign(rows.group.size(), 0.0);
  const auto for_each_number = [&](auto&& visit) {
    for (size_t index = 0; index < rows.group.size(); ++index) {
      const RowGroup& c = rows.group[index];
      for (int i = 0; !c.is_unilateral() && i < c.width(); ++i)
        visit(index, rows.column[c.column + i], std::abs(rows.value[c.value + i]));
    }
  };
  for_each_number([&](size_t, int column, double size) { sum_of_rows[column] += size; });
  for (const Tree& tree : trees.tree)
    add_magnitudes(trees, tree, sum_of_rows.data() + tree.begin, response.data() + tree.begin);
  for_each_number(
      [&](size_t index, int column, double size) { sums[index] += size * response[column]; });
}

// Forces of the `dim` rows of one contact or limit in overlap, for the predicted rates of its rows;
// `friction` holds dim - 1 coefficients.
void facet_forces(const ComFree& law, double mass, double gap, const double* predicted_rate,
                  const double* friction, int dim, double step, double* force) {
  const auto facet = [&](double rate) {
    return std::max(0.0, spring_damper(law, mass, gap, rate, step));
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

}  // namespace

double effective_mass(double impedance, double inverse_mass) {
  return 1.0 / std::max(kMinimumValue, inverse_mass * (1.0 - impedance) / impedance);
}

void update_complementarity_free(const ComFree& law, const Rows& rows, const Trees& trees,
                                 const std::vector<double>& gap, const std::vector<double>& mass,
                                 double step, RowData& data) {
  for (const RowGroup& c : rows.group)
    gather(rows, c, data.velocity.data(), data.rate.data() + c.row);
  for (size_t i = 0; i < data.velocity.size(); ++i)
    data.velocity[i] += step * data.smooth_acceleration[i];

  thread_local std::vector<double> couplings;
  find_couplings(rows, trees, couplings);
  const double gain = law.damping + law.stiffness * step;
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.is_unilateral() && gap[index] >= 0.0) continue;
    double rate[kMaxRows], force[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    if (c.kind == RowKind::kSlider) {
      const double limit = rows.friction[c.row];
      const double inverse =
          std::max({kMinimumValue, rows.inverse_mass[c.row], kOfCoupling * couplings[index]});
      force[0] = std::clamp(-rate[0] / (step * inverse), -limit, limit);
    } else if (c.kind == RowKind::kBilateral) {
      const double stable = std::min(mass[index], 1.0 / (gain * couplings[index]));
      force[0] = spring_damper(law, stable, gap[index], rate[0], step);
    } else {
      facet_forces(law, mass[index], gap[index], rate, rows.friction.data() + c.row + 1, c.dim,
                   step, force);
    }
    data.touched[index] = force[0] != 0.0;
    for (int i = 0; i < c.dim; ++i) data.total_impulse[c.row + i] = step * force[i];
    scatter(rows, c, data.total_impulse.data() + c.row, data.coordinate_impulse.data());
  }
  // Trees that nothing acts on may sleep, and have no factor.
  for (size_t tree = 0; tree < trees.tree.size(); ++tree) {
    const Tree& t = trees.tree[tree];
    const double* impulse = data.coordinate_impulse.data() + t.begin;
    if (std::any_of(impulse, impulse + t.count, [](double p) { return p != 0.0; }))
      add_solution(trees, static_cast<int>(tree), impulse, data.velocity.data() + t.begin);
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
