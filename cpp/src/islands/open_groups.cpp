#include "dashpot/islands/open_groups.hpp"

#include <algorithm>
#include <limits>

#include "dashpot/rows/hit.hpp"

namespace dashpot {

namespace {

// Of what bodies come nearer by at the speeds of the start, and as smooth forces change them.
constexpr double kMayMeet = 2.0;
constexpr double kInfinite = std::numeric_limits<double>::infinity();

}  // namespace

void OpenGroups::find(const StepView& step, const Rows& rows, int tree_count, const RowData& data) {
  gap_.assign(rows.group.size(), 0.0);
  closing_.assign(rows.group.size(), 0.0);
  fastest_.assign(tree_count, 0.0);
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (!c.is_unilateral()) continue;
    gap_[index] = c.kind == RowKind::kContact ? step.contacts[c.input].gap
                                              : step.constraints[c.input].position;
    double rate[kMaxRows], load[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    gather(rows, c, data.smooth_acceleration.data(), load);
    closing_[index] = std::max({-rate[0], -rate[0] - 0.5 * load[0] * step.length, 0.0});
    const bool flies = std::max(closing_[index], rate[0]) > hit_speed(rows, c);
    for (int tree : c.tree)
      if (tree >= 0) fastest_[tree] = flies ? kInfinite : std::max(fastest_[tree], closing_[index]);
  }
  stays_open_.assign(rows.group.size(), 0);
  for (size_t index = 0; index < rows.group.size(); ++index) {
    if (gap_[index] <= 0.0) continue;
    double closing = 0.0;
    for (int tree : rows.group[index].tree)
      if (tree >= 0) closing += fastest_[tree];
    stays_open_[index] = gap_[index] >= kMayMeet * step.length * closing;
  }
}

}  // namespace dashpot
