#include "dashpot/rows/holding_rows.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/lanes.hpp"
#include "dashpot/rows/mass_weighted.hpp"

namespace dashpot {

namespace {

// Fraction of its w that a row has to have beside those before it: at less it says the same.
constexpr double kNew = 1e-6;

// Which tree of a group it joins to the ground, if that is no free body, else -1.
int held_side(const RowGroup& c, const Trees& trees) {
  if ((c.tree[0] >= 0) == (c.tree[1] >= 0)) return -1;
  const int side = c.tree[0] >= 0 ? 0 : 1;
  return trees.tree[c.tree[side]].free_body ? -1 : side;
}

[[gnu::always_inline]] inline double dot(const double* a, const double* b, int count) {
  Lanes sum{};
  for (int i = 0; i < count; i += kLanes) sum += load_lanes(a + i) * load_lanes(b + i);
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

DASHPOT_VECTOR_CLONES
double product(const double* a, const double* b, int count) { return dot(a, b, count); }

// Takes from x (count) its share of every one of `rows`, which are orthonormal and `count` apart.
// All shares are found first, so that none waits for another.
DASHPOT_VECTOR_CLONES
void remove_shares(const double* rows, int number, int count, double* share, double* x) {
  for (int c = 0; c < number; ++c) share[c] = dot(x, rows + c * count, count);
  for_each_block(
      count, [=](int first, auto width) __attribute__((always_inline)) {
        Lanes rest[width()];
        load_block(x + first, rest);
        for (int c = 0; c < number; ++c) add_scaled(rows + c * count + first, -share[c], rest);
        store_block(rest, x + first);
      });
}

}  // namespace

void HoldingRows::reset(const Trees& trees) {
  count_.assign(trees.tree.size(), 0);
  basis_.resize(trees.tree.size());
}

void HoldingRows::find_at_start(const Rows& rows, const std::vector<ConstraintInput>& constraints,
                                const std::vector<Match>& matches, const Memory& memory,
                                const Trees& trees, double length) {
  reset(trees);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kContact && matches[i].nearest >= 0 && !matches[i].apart) {
      const RememberedContact before = memory.contact(matches[i].nearest);
      const double stiffness[kMaxRows] = {before.stiffness,       before.slide_stiffness,
                                          before.slide_stiffness, before.spin_stiffness,
                                          before.roll_stiffness,  before.roll_stiffness};
      add(rows, trees, i, stiffness, before.sticking != 0.0, length, true);
    } else if (c.kind == RowKind::kUnilateral) {
      const RememberedConstraint before = memory.constraint(constraints[c.input].memory);
      if (before.deformation < 0.0) add(rows, trees, i, &before.stiffness, false, length, true);
    }
  }
}

void HoldingRows::find_at_end(const Rows& rows, const RowData& data, const Trees& trees,
                              double length) {
  reset(trees);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kBilateral || (c.is_unilateral() && data.deformation[c.row] < 0.0))
      add(rows, trees, i, rows.stiffness.data() + c.row, data.sticking[i], length, false);
  }
}

void HoldingRows::add(const Rows& rows, const Trees& trees, size_t group, const double* stiffness,
                      bool sticks, double length, bool weighted) {
  const RowGroup& c = rows.group[group];
  const int side = held_side(c, trees);
  const auto swings = [&](int i) {
    return stiffness[i] * rows.inverse_mass[c.row + i] * length * length <= 1.0;
  };
  if (side < 0 || swings(0)) return;
  const Tree& t = trees.tree[c.tree[side]];
  for (int i = 0; i < (sticks ? c.dim : 1); ++i) {
    if (swings(i)) continue;
    row_.assign(t.count, 0.0);
    if (!weighted || c.is_of_one_coordinate(side)) {
      const int first = side == 0 ? 0 : c.columns[0];
      for (int at = first; at < first + c.columns[side]; ++at)
        row_[rows.column[c.column + at] - t.begin] = rows.value[c.value + i * c.width() + at];
      weight_row(trees, c.tree[side], row_.data());
    } else {
      const MassWeighted& y = c.weighted[side];
      const double* value = rows.weighted_value.data() + y.value + i * padded(y.count);
      for (int k = 0; k < y.count; ++k)
        row_[rows.weighted_column[y.column + k] - t.begin] = value[k];
    }
    add_row(c.tree[side], rows.inverse_mass[c.row + i]);
  }
}

// Gram and Schmidt.
void HoldingRows::add_row(int tree, double inverse_mass) {
  const int n = static_cast<int>(row_.size());
  remove(tree, n, row_.data());
  const double w = product(row_.data(), row_.data(), n);
  if (!(w > kNew * inverse_mass)) return;
  AlignedDoubles& basis = basis_[tree];
  const size_t begin = static_cast<size_t>(n) * count_[tree];
  basis.resize(std::max(basis.size(), begin + n));
  const double scale = 1.0 / std::sqrt(w);
  for (int i = 0; i < n; ++i) basis[begin + i] = scale * row_[i];
  ++count_[tree];
}

void HoldingRows::bar(const Trees& trees, int tree, double* change) {
  if (!hold(tree)) return;
  weight_motion(trees, tree, change);
  remove(tree, trees.tree[tree].count, change);
  unweight_motion(trees, tree, change);
}

void HoldingRows::remove(int tree, int n, double* x) {
  share_.resize(count_[tree]);
  remove_shares(basis_[tree].data(), count_[tree], n, share_.data(), x);
}

double HoldingRows::free_inverse_mass(const Trees& trees, int tree, int i) const {
  const int n = trees.tree[tree].count;
  thread_local AlignedDoubles own;  // kept by the thread: no allocation in a step
  own.assign(n, 0.0);
  own[i] = 1.0;
  weight_row(trees, tree, own.data());
  double left = product(own.data(), own.data(), n);
  for (int c = 0; c < count_[tree]; ++c) {
    const double share = product(own.data(), basis_[tree].data() + c * n, n);
    left -= share * share;
  }
  return left;
}

}  // namespace dashpot
