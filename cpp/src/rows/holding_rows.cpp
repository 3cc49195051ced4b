#include "dashpot/rows/holding_rows.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/lanes.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/mass_weighted.hpp"

namespace dashpot {

namespace {

// Fraction of its w that a row has to have beside those before it: at less it says the same.
constexpr double kNew = 1e-6;
// Fraction of a pivot that is rounding.
constexpr double kRounding = 1e-14;

// Which tree of a group it joins to the ground, if that is no free body, else -1.
int held_side(const RowGroup& c, const Trees& trees) {
  if ((c.tree[0] >= 0) == (c.tree[1] >= 0)) return -1;
  const int side = c.tree[0] >= 0 ? 0 : 1;
  return trees.tree[c.tree[side]].free_body ? -1 : side;
}

// Whether the spring of a contact or limit, compressed (m, > 0), throws back what hits it.
bool is_in_hit(const Rows& rows, const RowGroup& c, const RowData& data, double stiffness,
               double compression, double length) {
  const double rate = first_rate(rows, c, data.velocity);
  const double load = first_rate(rows, c, data.smooth_acceleration);
  const double kappa = stiffness * rows.inverse_mass[c.row];
  const double swing = std::hypot(rate, (kappa * compression + load) / std::sqrt(kappa));
  return swing > std::max(hit_speed(rows, c), 2.0 * std::abs(load) * length);
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
  held_.resize(trees.tree.size());
}

void HoldingRows::find_at_start(const StepView& step, const Rows& rows, const RowData& data,
                                const Trees& trees) {
  reset(trees);
  const auto throws_back = [&](const RowGroup& c, double stiffness, double compression) {
    return is_in_hit(rows, c, data, stiffness, compression, step.length);
  };
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kContact && step.matches[i].nearest >= 0 && !step.matches[i].parted) {
      const RememberedContact before = step.memory.contact(step.matches[i].nearest);
      if (throws_back(c, before.stiffness, before.compression)) continue;
      const double stiffness[kMaxRows] = {before.stiffness,       before.slide_stiffness,
                                          before.slide_stiffness, before.spin_stiffness,
                                          before.roll_stiffness,  before.roll_stiffness};
      add(rows, trees, c, stiffness, before.sticking != 0.0, step.length);
    } else if (c.kind == RowKind::kUnilateral) {
      const RememberedConstraint before = step.memory.constraint(step.constraints[c.input].memory);
      if (before.deformation < 0.0 && !throws_back(c, before.stiffness, -before.deformation))
        add(rows, trees, c, &before.stiffness, false, step.length);
    }
  }
}

void HoldingRows::add(const Rows& rows, const Trees& trees, const RowGroup& c,
                      const double* stiffness, bool sticks, double length) {
  const int side = held_side(c, trees);
  const auto swings = [&](int i) {
    return stiffness[i] * rows.inverse_mass[c.row + i] * length * length <= 1.0;
  };
  if (side < 0 || trees.is_soft(c.tree[side]) || swings(0)) return;
  const Tree& t = trees.tree[c.tree[side]];
  for (int i = 0; i < (sticks ? c.dim : 1); ++i) {
    if (swings(i)) continue;
    row_.assign(t.count, 0.0);
    if (c.is_of_one_coordinate(side)) {
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
    add_row(c.tree[side], c.row + i, rows.inverse_mass[c.row + i]);
  }
}

// Gram and Schmidt.
void HoldingRows::add_row(int tree, int row, double inverse_mass) {
  const int n = static_cast<int>(row_.size());
  OfTree& held = held_[tree];
  if (!hold(tree)) {
    held.sums.clear();
    held.coefficients.clear();
    held.borne.clear();
  }
  const size_t first = held.coefficients.size();
  held.coefficients.resize(first + count_[tree] + 1);
  remove(tree, n, row_.data(), held.coefficients.data() + first);
  const double w = product(row_.data(), row_.data(), n), root = std::sqrt(w);
  const bool says_new = w > kNew * inverse_mass;
  if (says_new)
    held.coefficients.back() = root;
  else
    held.coefficients.pop_back();
  if (!says_new && !hold(tree)) return;
  held.sums.push_back({row, static_cast<int>(first), count_[tree] + says_new, inverse_mass});
  if (!says_new) return;
  held.borne.push_back(0.0);
  const size_t begin = static_cast<size_t>(n) * count_[tree];
  held.basis.resize(std::max(held.basis.size(), begin + n));
  const double scale = 1.0 / root;
  for (int i = 0; i < n; ++i) held.basis[begin + i] = scale * row_[i];
  ++count_[tree];
}

void HoldingRows::bar(const Trees& trees, int tree, double* change, double weight) {
  if (!hold(tree)) return;
  weight_motion(trees, tree, change);
  share_.resize(count_[tree]);
  remove(tree, trees.tree[tree].count, change, share_.data());
  unweight_motion(trees, tree, change);
  for (int c = 0; c < count_[tree]; ++c) held_[tree].borne[c] += weight * share_[c];
}

void HoldingRows::forget_borne() {
  for (size_t tree = 0; tree < count_.size(); ++tree)
    if (count_[tree] > 0) std::fill(held_[tree].borne.begin(), held_[tree].borne.end(), 0.0);
}

// Of rows that each say something new the coefficients C are a triangle, C' p = -borne.
void HoldingRows::add_borne(int tree, double scale, std::vector<double>& impulse) {
  if (!hold(tree)) return;
  const OfTree& held = held_[tree];
  if (held.sums.size() > held.borne.size()) return share_borne(held, scale, impulse);
  rest_ = held.borne;
  for (int i = count_[tree] - 1; i >= 0; --i) {
    const double* coefficient = held.coefficients.data() + held.sums[i].first;
    const double p = rest_[i] / coefficient[i];
    for (int c = 0; c < i; ++c) rest_[c] -= coefficient[c] * p;
    impulse[held.sums[i].row] -= scale * p;
  }
}

// p = -inv(W) C x with C' inv(W) C x = borne, W = diag(w), by Cholesky.
void HoldingRows::share_borne(const OfTree& held, double scale, std::vector<double>& impulse) {
  const int n = static_cast<int>(held.borne.size());
  square_.assign(n * n, 0.0);
  for (const Sum& sum : held.sums) {
    const double* coefficient = held.coefficients.data() + sum.first;
    for (int i = 0; i < sum.count; ++i) {
      const double weighted = coefficient[i] / sum.inverse_mass;
      for (int k = 0; k <= i; ++k) square_[i * n + k] += weighted * coefficient[k];
    }
  }
  rest_ = held.borne;
  for (int i = 0; i < n; ++i) {
    double* row = square_.data() + i * n;
    for (int k = 0; k <= i; ++k) {
      const double* other = square_.data() + k * n;
      double left = row[k];
      for (int c = 0; c < k; ++c) left -= row[c] * other[c];
      row[k] = k < i ? left / other[k] : std::sqrt(std::max(left, kRounding * row[i]));
    }
    for (int c = 0; c < i; ++c) rest_[i] -= row[c] * rest_[c];
    rest_[i] /= row[i];
  }
  for (int i = n - 1; i >= 0; --i) {
    rest_[i] /= square_[i * n + i];
    for (int c = 0; c < i; ++c) rest_[c] -= square_[i * n + c] * rest_[i];
  }
  for (const Sum& sum : held.sums) {
    const double* coefficient = held.coefficients.data() + sum.first;
    double p = 0.0;
    for (int c = 0; c < sum.count; ++c) p += coefficient[c] * rest_[c];
    impulse[sum.row] -= scale * p / sum.inverse_mass;
  }
}

void HoldingRows::remove(int tree, int n, double* x, double* share) const {
  remove_shares(held_[tree].basis.data(), count_[tree], n, share, x);
}

}  // namespace dashpot
