#include "dashpot/islands/inactive_contacts.hpp"

#include <algorithm>
#include <limits>

#include "dashpot/rows/hit.hpp"

namespace dashpot {

namespace {

// Of what bodies come nearer by at the speeds of the start, and as smooth forces change them.
constexpr double kMayMeet = 2.0;
constexpr double kInfinite = std::numeric_limits<double>::infinity();

double gap_of(const StepView& step, const RowGroup& c) {
  if (!c.is_unilateral()) return 0.0;
  return c.kind == RowKind::kContact ? step.contacts[c.input].gap
                                     : step.constraints[c.input].position;
}

// How fast a gap changes (m/s or rad/s), and with which smooth acceleration.
struct GapMotion {
  double rate = 0.0, acceleration = 0.0;
  // The fastest that it closes on the average of a step, or from its start.
  double closing(double length) const {
    return std::max({-rate, -rate - 0.5 * acceleration * length, 0.0});
  }
};

GapMotion motion_of(const Rows& rows, const RowGroup& c, const RowData& data) {
  return {first_rate(rows, c, data.velocity), first_rate(rows, c, data.smooth_acceleration)};
}

}  // namespace

void InactiveContacts::find(const StepView& step, const Rows& rows,
                            const std::vector<Island>& islands, int tree_count,
                            const RowData& data) {
  stays_open_.assign(rows.group.size(), 0);
  fastest_.assign(tree_count, kUnasked);
  bool any = false;
  for (const RowGroup& c : rows.group) {
    if (gap_of(step, c) <= 0.0) continue;
    any = true;
    for (int tree : c.tree)
      if (tree >= 0) fastest_[tree] = 0.0;
  }
  if (!any) return;
  for (const RowGroup& c : rows.group) find_fastest(rows, c, step.length, data);
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    const double gap = gap_of(step, c);
    double closing = 0.0;
    for (int tree : c.tree)
      if (tree >= 0) closing += fastest_[tree];
    stays_open_[index] = gap > 0.0 && gap >= kMayMeet * step.length * closing;
  }
  for (const Island& island : islands) {
    const auto is_hit = [&](int index) { return data.hit[index] != Hit::kNone; };
    if (std::any_of(island.group.begin(), island.group.end(), is_hit))
      for (int index : island.group) stays_open_[index] = 0;
  }
}

// Notes how fast a group's gap closes on those of its trees that have an open one.
void InactiveContacts::find_fastest(const Rows& rows, const RowGroup& c, double length,
                                    const RowData& data) {
  const auto is_asked = [&](int tree) {
    return tree >= 0 && fastest_[tree] != kUnasked && fastest_[tree] != kInfinite;
  };
  if (!c.is_unilateral() || !(is_asked(c.tree[0]) || is_asked(c.tree[1]))) return;
  const GapMotion motion = motion_of(rows, c, data);
  const double closing = motion.closing(length);
  const bool flies = std::max(closing, motion.rate) > hit_speed(rows, c);
  for (int tree : c.tree)
    if (is_asked(tree)) fastest_[tree] = flies ? kInfinite : std::max(fastest_[tree], closing);
}

}  // namespace dashpot
