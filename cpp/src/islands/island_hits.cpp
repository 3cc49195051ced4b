#include "dashpot/islands/island_hits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dashpot {

namespace {

// The gap of a group (m or rad), its rate at the start, but in the geometry that its rows have, and
// by how much smooth forces, and the turn of that geometry, change it in the step, and did before.
struct GapMotion {
  double gap, rate, change, turn = 0.0, turned = 0.0;

  // The fastest that the gap closes on the average of the step, or from its start.
  double closing() const {
    const double start = rate - turned;
    return std::max({-start, -start - 0.5 * (change + turn), 0.0});
  }
  // How fast it closes a gap (> 0) that closes within `length` (s), then.
  double closing_at_onset(double length) const {
    const double start = rate - turned, closes = (change + turn) / length;
    return std::sqrt(std::max(0.0, start * start - 2.0 * closes * gap));
  }
};

double gap_of(const StepView& step, const RowGroup& c) {
  return c.kind == RowKind::kContact ? step.contacts[c.input].gap
                                     : step.constraints[c.input].position;
}

// Without what turns.
GapMotion motion_of(const StepView& step, const Rows& rows, const RowGroup& c,
                    const RowData& data) {
  return {gap_of(step, c), first_rate(rows, c, data.velocity),
          first_rate(rows, c, data.smooth_acceleration) * step.length};
}

// The hits of one step.
struct Hits {
  const StepView& step;
  const Rows& rows;
  const HitFrequency& frequency;
  const RowData& data;

  GapMotion motion_of(const RowGroup& c) const {
    GapMotion motion = dashpot::motion_of(step, rows, c, data);
    if (c.is_of_round_hit) {
      motion.turn = c.turning[0] * step.length;
      motion.turned = c.turning[0] * c.ahead;
    }
    return motion;
  }

  bool is_hit(int index, bool alone) const {
    const RowGroup& c = rows.group[index];
    // The flow of a limit alone is exact at any micro-step, and that of one beside the other end.
    if (!c.is_unilateral() || (alone && c.kind == RowKind::kUnilateral)) return false;
    const GapMotion motion = motion_of(c);
    if (motion.gap - step.length * motion.closing() >= 0.0) return false;
    // What was apart, and comes into touch, is hit, also where a drive has just set it in motion.
    if (motion.gap > 0.0 && step.matches[index].nearest < 0)
      return motion.closing_at_onset(step.length) > hit_speed(rows, c);
    return std::abs(motion.rate) > std::max(hit_speed(rows, c), 2.0 * std::abs(motion.change));
  }

  // Whether what was hit in the last step, and hangs at its deepest as this one begins, is still
  // thrown back: its spring bears more than smooth forces, and gives it speed.
  bool goes_on(int index) const {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact || step.matches[index].nearest < 0) return false;
    const RememberedContact old = step.memory.contact(step.matches[index].nearest);
    const double w = rows.inverse_mass[c.row], throws = old.stiffness * old.compression * w;
    return old.was_hit_now() &&
           (is_short_hit(old.stiffness, w, step.length) || c.is_of_round_hit) &&
           step.length * throws >
               std::max(hit_speed(rows, c), kHitLoads * std::abs(motion_of(c).change));
  }

  double onset(const RowGroup& c) const {
    const GapMotion motion = motion_of(c);
    return onset_in(step.length, motion.gap, motion.closing());
  }

  // Of two contacts that push one tree, whether the second disturbs what the first hits.
  bool disturbs(const RowGroup& other, const RowGroup& hit, double deepest) const {
    const double begins = onset(other);
    if (std::isinf(begins)) return false;
    bool apart = true;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j) {
        if (hit.tree[i] < 0 || hit.tree[i] != other.tree[j]) continue;
        apart = false;
        if (disturbs_hit(begins, push_on(other, j), push_on(hit, i), deepest)) return true;
      }
    return apart;
  }

  // The direction in which a contact pushes the tree on a side.
  std::array<double, 3> push_on(const RowGroup& c, int side) const {
    const auto& frame = step.contacts[c.input].frame;
    const double sign = side == 0 ? -1.0 : 1.0;
    return {sign * frame[0], sign * frame[1], sign * frame[2]};
  }

  // Whether contacts between the two trees of the first to touch are all that counts in an island.
  bool is_of_two_trees(const Island& island) const {
    if (std::any_of(island.group.begin(), island.group.end(),
                    [&](int index) { return rows.group[index].kind != RowKind::kContact; }))
      return false;
    int first = *island.group.begin();
    double begins = std::numeric_limits<double>::infinity();
    if (are_all_between(island, rows.group[first])) return true;
    for (int index : island.group)
      if (const double at = onset(rows.group[index]); at < begins) {
        first = index;
        begins = at;
      }
    const RowGroup& hit = rows.group[first];
    const double w = rows.inverse_mass[hit.row];
    if (std::isinf(begins) || w == 0.0) return false;
    const double deepest = deepest_of_hit(begins, frequency(step.contacts[hit.input], w));
    return std::all_of(island.group.begin(), island.group.end(), [&](int index) {
      const RowGroup& c = rows.group[index];
      return joins_same_trees(c.tree, hit.tree) || !disturbs(c, hit, deepest);
    });
  }

  bool are_all_between(const Island& island, const RowGroup& one) const {
    return std::all_of(island.group.begin(), island.group.end(), [&](int index) {
      return joins_same_trees(rows.group[index].tree, one.tree);
    });
  }
};

// Of what bodies come nearer by at the speeds of the start, and as smooth forces change them.
constexpr double kMayMeet = 2.0;
constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kUnasked = -1.0;

// Notes how fast a group's gap closes on those of its trees that have an open one. `fastest`: by
// tree, m/s or rad/s: infinite where it flies, kUnasked where it has no inactive contact.
void find_fastest(const StepView& step, const Rows& rows, const RowGroup& c, const RowData& data,
                  std::vector<double>& fastest) {
  const auto is_asked = [&](int tree) {
    return tree >= 0 && fastest[tree] != kUnasked && fastest[tree] != kInfinite;
  };
  if (!c.is_unilateral() || !(is_asked(c.tree[0]) || is_asked(c.tree[1]))) return;
  const GapMotion motion = motion_of(step, rows, c, data);
  const double closing = motion.closing();
  const bool flies = std::max(closing, motion.rate) > hit_speed(rows, c);
  for (int tree : c.tree)
    if (is_asked(tree)) fastest[tree] = flies ? kInfinite : std::max(fastest[tree], closing);
}

}  // namespace

void find_hits(const StepView& step, const Rows& rows, const std::vector<Island>& islands,
               const HitFrequency& frequency, RowData& data) {
  const Hits hits{step, rows, frequency, data};
  for (const Island& island : islands) {
    const int count = island.group_count();
    const bool alone =
        count == 1 || (count == 2 && rows.group[*island.group.first].is_end_of_range);
    if (!island.has_few_groups()) continue;
    const bool isolated_pair = hits.is_of_two_trees(island);
    for (int index : island.group) {
      data.is_of_isolated_pair[index] = isolated_pair;
      data.hit[index] = hits.is_hit(index, alone)              ? Hit::kNow
                        : isolated_pair && hits.goes_on(index) ? Hit::kBefore
                                                               : Hit::kNone;
    }
  }
}

void find_inactive_contacts(const StepView& step, const Rows& rows,
                            const std::vector<Island>& islands, int tree_count, const RowData& data,
                            std::vector<char>& stays_open) {
  stays_open.assign(rows.group.size(), 0);
  thread_local std::vector<double> fastest;  // kept by the thread: no allocation in a step
  fastest.assign(tree_count, kUnasked);
  bool any = false;
  for (const RowGroup& c : rows.group) {
    if (!c.is_unilateral() || gap_of(step, c) <= 0.0) continue;
    any = true;
    for (int tree : c.tree)
      if (tree >= 0) fastest[tree] = 0.0;
  }
  if (!any) return;
  for (const RowGroup& c : rows.group) find_fastest(step, rows, c, data, fastest);
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    const double gap = c.is_unilateral() ? gap_of(step, c) : 0.0;
    double closing = 0.0;
    for (int tree : c.tree)
      if (tree >= 0) closing += fastest[tree];
    stays_open[index] = gap > 0.0 && gap >= kMayMeet * step.length * closing;
  }
  for (const Island& island : islands) {
    const auto is_hit = [&](int index) { return data.hit[index] != Hit::kNone; };
    if (std::any_of(island.group.begin(), island.group.end(), is_hit))
      for (int index : island.group) stays_open[index] = 0;
  }
}

}  // namespace dashpot
