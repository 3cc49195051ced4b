#include "dashpot/integrate/common_translation.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/model/trees.hpp"

namespace dashpot {

namespace {

// Fraction of the terms of a rate up to which they cancel.
constexpr double kCancelled = 1e-9;

// Whether a row has no rate in a motion.
bool is_at_rest(const Rows& rows, const RowGroup& c, const std::vector<double>& motion) {
  double rate = 0.0, most = 0.0;
  for (int k = 0; k < c.columns[0] + c.columns[1]; ++k) {
    const double part = rows.value[c.value + k] * motion[rows.column[c.column + k]];
    rate += part;
    most = std::max(most, std::abs(part));
  }
  return std::abs(rate) <= kCancelled * most;
}

}  // namespace

void CommonTranslations::find(const mjModel_* model, const mjData_* d, const Rows& rows,
                              const Trees& trees, const std::vector<int>& first_tree) {
  count_.assign(first_tree.size(), 0);
  candidates_.assign(first_tree.size(), {});
  for (int equality : rows.equality) {
    const RowGroup& c = rows.group[equality];
    const int first = first_tree[c.tree[0]];
    Candidates& of_first = candidates_[first];
    if (of_first.count < 0)
      of_first.count = host::translations(model, d, first, of_first.direction.data());
  }
  for (int i = 0; i < kDirections; ++i) find_common(i, model, d, rows, trees, first_tree);
}

void CommonTranslations::find_common(int direction, const mjModel_* model, const mjData_* d,
                                     const Rows& rows, const Trees& trees,
                                     const std::vector<int>& first_tree) {
  const auto has_it = [&](const Candidates& c) { return c.count > direction; };
  any_[direction] = false;
  if (std::none_of(candidates_.begin(), candidates_.end(), has_it)) return;
  is_common_.resize(first_tree.size());
  std::transform(candidates_.begin(), candidates_.end(), is_common_.begin(), has_it);
  std::vector<double>& motion = motion_[direction];
  motion.assign(trees.coordinates, 0.0);
  const auto is_common = [&](int first) { return first >= 0 && is_common_[first]; };
  for (size_t index = 0; index < first_tree.size(); ++index) {
    const int first = first_tree[index];
    if (is_common(first))
      is_common_[first] =
          host::add_translation(model, d, trees, static_cast<int>(index),
                                candidates_[first].direction.data() + 3 * direction, motion.data());
  }
  for (int equality : rows.equality) {
    const RowGroup& c = rows.group[equality];
    const int first = first_tree[c.tree[0]];
    if (is_common(first)) is_common_[first] = is_at_rest(rows, c, motion);
  }
  for (size_t index = 0; index < first_tree.size(); ++index) {
    const Tree& t = trees.tree[index];
    if (!is_common(first_tree[index])) std::fill_n(motion.begin() + t.begin, t.count, 0.0);
  }
  for (size_t first = 0; first < count_.size(); ++first) {
    count_[first] += is_common_[first];
    any_[direction] = any_[direction] || is_common_[first];
  }
}

}  // namespace dashpot
