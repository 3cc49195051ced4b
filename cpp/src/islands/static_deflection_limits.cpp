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

// By motion coordinate: limit of the dry friction of joints times sqrt(w_d).
void find_dry_friction(const Rows& rows, size_t constraints, std::vector<double>& dry_friction) {
  dry_friction.clear();
  for (size_t i = 0; i < constraints; ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kSlider || c.is_damper || !c.is_of_one_coordinate(0)) continue;
    const int coordinate = rows.column[c.column];
    if (static_cast<int>(dry_friction.size()) <= coordinate) dry_friction.resize(coordinate + 1);
    dry_friction[coordinate] += rows.friction[c.row] * std::sqrt(rows.inverse_mass[c.row]);
  }
}

// By tree: of what it touches, the largest mass over its own.
void find_heavier(const Rows& rows, std::vector<double>& heavier) {
  heavier.clear();
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact || c.tree[0] < 0 || c.tree[1] < 0) continue;
    const auto [w0, w1] = rows.tree_inverse_mass[c.row];
    if (w0 == 0.0 || w1 == 0.0) continue;
    const int light = c.tree[w0 > w1 ? 0 : 1];
    if (static_cast<int>(heavier.size()) <= light) heavier.resize(light + 1, 1.0);
    heavier[light] = std::max(heavier[light], std::max(w0 / w1, w1 / w0));
  }
}

// Of a contact with what does not move: what is heavier on the tree presses it down, too.
double heavier_on(const RowGroup& c, const std::vector<double>& heavier) {
  if (c.tree[0] >= 0 && c.tree[1] >= 0) return 1.0;
  const int tree = std::max(c.tree[0], c.tree[1]);
  return tree < static_cast<int>(heavier.size()) ? heavier[tree] : 1.0;
}

// How fast (m/s^2) the dry friction of joints accelerates what a contact moves, at most: |A_nd| <=
// sqrt(w_n w_d) of the contact's normal n and a joint d.
double held_acceleration(const Rows& rows, const RowGroup& c,
                         const std::vector<double>& dry_friction) {
  if (dry_friction.empty() || c.pair >= 0) return 0.0;
  double sum = 0.0;
  const int* const column = rows.column.data() + c.column;
  for (int k = 0; k < c.columns[0] + c.columns[1]; ++k)
    if (column[k] < static_cast<int>(dry_friction.size())) sum += dry_friction[column[k]];
  return sum * std::sqrt(rows.inverse_mass[c.row]);
}

}  // namespace

void find_deflection_times(const mjModel_* model, const StepView& step, const Rows& rows,
                           const AlignedDoubles& velocity, Team& team,
                           std::vector<DeflectionTime>& of_group) {
  // Kept by the thread: no allocation in a step. Others of the team read them.
  thread_local std::vector<double> kept_friction, kept_heavier;
  std::vector<double>&dry_friction = kept_friction, &heavier = kept_heavier;
  const double gravity = host::gravity(model);
  of_group.assign(rows.group.size(), DeflectionTime());
  find_dry_friction(rows, step.constraints.size(), dry_friction);
  find_heavier(rows, heavier);
  if (gravity == 0.0 && dry_friction.empty()) return;
  team.for_each(static_cast<int>(rows.group.size()), kGroupsAtOnce, [&](int i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact) return;
    DeflectionTime& time = of_group[i];
    const double sag = kRigidSag * host::bearing_radius(model, step.contacts[c.input]);
    if (gravity > 0.0) time.weight = std::sqrt(sag / (gravity * heavier_on(c, heavier)));
    if (const double held = held_acceleration(rows, c, dry_friction); held > 0.0)
      time.dry_friction = std::sqrt(sag / held);
    if (step.matches[i].load == 0.0 || c.tree[0] < 0 || c.tree[1] < 0) return;
    if (std::abs(first_rate(rows, c, velocity)) * step.length > kStillSag * sag) return;
    const double acceleration = kLoadGrowth * step.matches[i].load * rows.inverse_mass[c.row];
    time.load = std::sqrt(sag / std::max(acceleration, gravity));
  });
}

}  // namespace dashpot
