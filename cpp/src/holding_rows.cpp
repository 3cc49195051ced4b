#include "dashpot/holding_rows.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/instruction_sets.hpp"
#include "dashpot/lane_blocks.hpp"
#include "dashpot/lanes.hpp"

namespace dashpot {

namespace {

// Part of its w that a row has to have beside those before it: at less it says the same.
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

// Takes from x (count) its share of every combination: `probe` is what finds the share, `part` what
// goes, the ones of a combination `stride` after those of another. All shares are found first, so
// that none waits for another.
DASHPOT_VECTOR_CLONES
void remove_shares(const double* probe, const double* part, int combinations, int stride, int count,
                   double* share, double* x) {
  for (int c = 0; c < combinations; ++c) share[c] = dot(x, probe + c * stride, count);
  for_each_block(
      count, [=](int first, auto width) __attribute__((always_inline)) {
        Lanes rest[width()];
        load_block(x + first, rest);
        for (int c = 0; c < combinations; ++c)
          add_scaled(part + c * stride + first, -share[c], rest);
        store_block(rest, x + first);
      });
}

// response = inverse force, columns `count` apart.
DASHPOT_VECTOR_CLONES
void respond(const double* inverse, const double* force, int n, int count, double* response) {
  for_each_block(
      count, [=](int first, auto width) __attribute__((always_inline)) {
        Lanes sum[width()] = {};
        for (int j = 0; j < n; ++j)
          if (force[j] != 0.0) add_scaled(inverse + j * count + first, force[j], sum);
        store_block(sum, response + first);
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
    if (c.kind == RowKind::kContact && matches[i].nearest >= 0) {
      const RememberedContact before = memory.contact(matches[i].nearest);
      add(rows, trees, i, before.stiffness, before.sticking != 0.0, length);
    } else if (c.kind == RowKind::kUnilateral) {
      const RememberedConstraint before = memory.constraint(constraints[c.input].memory);
      if (before.deformation < 0.0) add(rows, trees, i, before.stiffness, false, length);
    }
  }
}

void HoldingRows::find_at_end(const Rows& rows, const RowData& data, const Trees& trees,
                              double length) {
  reset(trees);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kBilateral || (c.is_unilateral() && data.deformation[c.row] < 0.0))
      add(rows, trees, i, rows.stiffness[c.row], data.sticking[i], length);
  }
}

void HoldingRows::add(const Rows& rows, const Trees& trees, size_t group, double stiffness,
                      bool sticks, double length) {
  const RowGroup& c = rows.group[group];
  const int side = held_side(c, trees);
  if (side < 0 || stiffness * rows.inverse_mass[c.row] * length * length <= 1.0) return;
  const Tree& t = trees.tree[c.tree[side]];
  const int offset = side == 0 ? 0 : c.columns[0];
  for (int i = 0; i < (sticks ? c.dim : 1); ++i) {
    row_.assign(t.count, 0.0);
    const double* value = rows.value.data() + c.value + i * c.width() + offset;
    for (int k = 0; k < c.columns[side]; ++k)
      row_[rows.column[c.column + offset + k] - t.begin] = value[k];
    add_row(trees, c.tree[side], rows.inverse_mass[c.row + i]);
  }
}

// Gram and Schmidt, in the product of inv(H).
void HoldingRows::add_row(const Trees& trees, int tree, double inverse_mass) {
  const Tree& t = trees.tree[tree];
  const int n = t.count;
  AlignedDoubles& basis = basis_[tree];
  const size_t begin = static_cast<size_t>(2 * n) * count_[tree];
  basis.resize(std::max(basis.size(), begin + 2 * n));
  remove(tree, n, basis.data() + n, basis.data(), row_.data());
  double* row = basis.data() + begin;
  double* way = row + n;
  respond(trees.inverse.data() + t.inverse, row_.data(), t.dof_count, n, way);
  const double w = product(row_.data(), way, n);
  if (!(w > kNew * inverse_mass)) return;
  const double scale = 1.0 / std::sqrt(w);
  for (int i = 0; i < n; ++i) {
    row[i] = scale * row_[i];
    way[i] *= scale;
  }
  ++count_[tree];
}

void HoldingRows::bar(const Trees& trees, int tree, double* change) {
  if (!hold(tree)) return;
  const int n = trees.tree[tree].count;
  remove(tree, n, basis_[tree].data(), basis_[tree].data() + n, change);
}

void HoldingRows::remove(int tree, int n, const double* probe, const double* part, double* x) {
  share_.resize(count_[tree]);
  remove_shares(probe, part, count_[tree], 2 * n, n, share_.data(), x);
}

double HoldingRows::barred_inverse_mass(const Trees& trees, int tree, int i) const {
  const int n = trees.tree[tree].count;
  double sum = 0.0;
  for (int c = 0; c < count_[tree]; ++c) {
    const double way = basis_[tree][(2 * c + 1) * n + i];
    sum += way * way;
  }
  return sum;
}

}  // namespace dashpot
