#include "spring_places.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

constexpr double kRounding = 1e-9;  // relative, of stiffness by inverse mass

}  // namespace

bool begins_stretched(const Memory& memory, const ConstraintInput& input, const RowGroup& c) {
  return input.has_solref && (c.kind == RowKind::kBilateral || memory.starts());
}

SpringPlace place_of_spring(const ConstraintInput& input, const Rows& rows, const RowGroup& c) {
  const double x = input.position, k = rows.stiffness[c.row];
  const double bears = c.solref.load / (rows.typical_inverse_mass[c.row] * k);
  const bool resolved = c.solref.load > 0.0 && bears <= (1.0 + kRounding) * std::abs(x);
  return {resolved ? std::copysign(bears, x) : x, resolved ? c.stored : 0.5 * k * x * x};
}

bool grows_stiffer(const StepView& step, const Rows& rows, size_t first) {
  const auto begin = rows.group.begin() + first;
  return std::any_of(begin, begin + step.constraints[begin->input].together,
                     [](const RowGroup& c) { return c.solref.load > 0.0; });
}

double part_of_places(const StepView& step, const Rows& rows, size_t first, double& energy_tank) {
  double stored = 0.0, remembered = 0.0;
  for (int i = 0; i < step.constraints[rows.group[first].input].together; ++i) {
    const RowGroup& c = rows.group[first + i];
    const ConstraintInput& input = step.constraints[c.input];
    const RememberedConstraint old = step.memory.constraint(input.memory);
    if (old.stiffness == 0.0 && begins_stretched(step.memory, input, c)) return 1.0;
    stored += place_of_spring(input, rows, c).stored;
    remembered += 0.5 * old.stiffness * old.deformation * old.deformation + old.beyond;
  }
  energy_tank = std::min(energy_tank, std::max(0.0, remembered)) + remembered - stored;
  if (energy_tank >= 0.0 || stored <= 0.0) return 1.0;
  const double left = std::max(0.0, stored + energy_tank);
  energy_tank = std::min(0.0, stored + energy_tank);
  return std::sqrt(left / stored);
}

}  // namespace dashpot
