#include "dashpot/islands/static_deflection_limits.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/model/properties.hpp"

namespace dashpot {

namespace {

// Fraction of the sag that a contact may close or open by in a step for its load to be known: more,
// and what lands sinks in before its load is felt; less, and a change of stiffness alone seems to
// move a grasp. And how often that load goes into the one that a contact is stiff enough for.
constexpr double kStillSag = 0.03;
constexpr double kLoadGrowth = 4.0;
constexpr int kGroupsAtOnce = 128;  // by a thread

}  // namespace

void StaticDeflectionLimits::find_dry_friction(const Rows& rows, size_t constraints) {
  dry_friction_.clear();
  for (size_t i = 0; i < constraints; ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kSlider || c.is_damper || !c.is_of_one_coordinate(0)) continue;
    const int coordinate = rows.column[c.column];
    if (static_cast<int>(dry_friction_.size()) <= coordinate) dry_friction_.resize(coordinate + 1);
    dry_friction_[coordinate] += rows.friction[c.row] * std::sqrt(rows.inverse_mass[c.row]);
  }
}

void StaticDeflectionLimits::find_heavier(const Rows& rows) {
  heavier_.clear();
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact || c.tree[0] < 0 || c.tree[1] < 0) continue;
    const auto [w0, w1] = rows.tree_inverse_mass[c.row];
    if (w0 == 0.0 || w1 == 0.0) continue;
    const int light = c.tree[w0 > w1 ? 0 : 1];
    if (static_cast<int>(heavier_.size()) <= light) heavier_.resize(light + 1, 1.0);
    heavier_[light] = std::max(heavier_[light], std::max(w0 / w1, w1 / w0));
  }
}

double StaticDeflectionLimits::heavier_on(const RowGroup& c) const {
  if (c.tree[0] >= 0 && c.tree[1] >= 0) return 1.0;
  const int tree = std::max(c.tree[0], c.tree[1]);
  return tree < static_cast<int>(heavier_.size()) ? heavier_[tree] : 1.0;
}

double StaticDeflectionLimits::held_acceleration(const Rows& rows, const RowGroup& c) const {
  if (dry_friction_.empty() || c.pair >= 0) return 0.0;
  double sum = 0.0;
  const int* const column = rows.column.data() + c.column;
  for (int k = 0; k < c.columns[0] + c.columns[1]; ++k)
    if (column[k] < static_cast<int>(dry_friction_.size())) sum += dry_friction_[column[k]];
  return sum * std::sqrt(rows.inverse_mass[c.row]);
}

void StaticDeflectionLimits::find(const mjModel_* model, const StepView& step, const Rows& rows,
                                  const AlignedDoubles& velocity, Team& team) {
  const double gravity = host::gravity(model);
  of_group_.assign(rows.group.size(), DeflectionTime());
  find_dry_friction(rows, step.constraints.size());
  find_heavier(rows);
  if (gravity == 0.0 && dry_friction_.empty()) return;
  team.for_each(static_cast<int>(rows.group.size()), kGroupsAtOnce, [&](int i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact) return;
    DeflectionTime& time = of_group_[i];
    const double sag = kRigidSag * host::bearing_radius(model, step.contacts[c.input]);
    if (gravity > 0.0) time.weight = std::sqrt(sag / (gravity * heavier_on(c)));
    if (const double held = held_acceleration(rows, c); held > 0.0)
      time.dry_friction = std::sqrt(sag / held);
    if (step.matches[i].load == 0.0 || c.tree[0] < 0 || c.tree[1] < 0) return;
    if (std::abs(first_rate(rows, c, velocity)) * step.length > kStillSag * sag) return;
    const double acceleration = kLoadGrowth * step.matches[i].load * rows.inverse_mass[c.row];
    time.load = std::sqrt(sag / std::max(acceleration, gravity));
  });
}

}  // namespace dashpot
