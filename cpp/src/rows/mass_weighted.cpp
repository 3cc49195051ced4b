#include "dashpot/rows/mass_weighted.hpp"

#include <algorithm>
#include <iterator>
#include <vector>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

namespace {

// Whether columns, which rise, have all that is above them among them, as those of contacts do.
bool is_closed(const int* column, int count, const Tree& t, const int* above) {
  for (int k = 0; k < count; ++k) {
    const int dof = above[t.dof_begin + column[k] - t.begin];
    if (dof < 0) continue;
    const int wanted = t.begin + dof - t.dof_begin;
    int i = k - 1;
    while (i >= 0 && column[i] > wanted) --i;
    if (i < 0 || column[i] != wanted) return false;
  }
  return true;
}

// Appends the columns of a group in one tree and all that are above them, the lowest first.
int append_reached(const int* column, int count, const Tree& t, const int* above,
                   std::vector<int>& reached) {
  if (is_closed(column, count, t, above)) {
    reached.insert(reached.end(), std::make_reverse_iterator(column + count),
                   std::make_reverse_iterator(column));
    return count;
  }
  thread_local std::vector<char> marked;  // kept by the thread: no allocation in a step
  marked.resize(std::max<size_t>(marked.size(), t.dof_count), 0);
  int lowest = 0, left = 0;
  for (int k = 0; k < count; ++k) {
    int dof = t.dof_begin + column[k] - t.begin;
    lowest = std::max(lowest, dof - t.dof_begin);
    for (; dof >= 0 && !marked[dof - t.dof_begin]; dof = above[dof], ++left)
      marked[dof - t.dof_begin] = 1;
  }
  const int all = left;
  for (int i = lowest; left > 0; --i) {
    if (!marked[i]) continue;
    marked[i] = 0;
    reached.push_back(t.begin + i);
    --left;
  }
  return all;
}

// The factor L^T D L of a tree's inertia; degrees of freedom from `dof_begin` on.
struct Factor {
  const double* entry;  // of L
  const int* row;       // where its rows begin
  const double* inverse_root;
  const int* above;
  int dof_begin;
};

// Rows x over the columns that they reach, the lowest first, numbered from `begin` on. `x` has
// `Parts` lanes of rows for each coordinate of the tree.
struct ReachedRows {
  const int* column;
  int count, begin, dim;
  double* x;
};

// y = x inv(D^1/2 L), rows `stride` apart, and the diagonal of y y': what every row leaves is taken
// off the ones above. `x` is zero afterwards.
template <int Parts>
[[gnu::always_inline]] inline void weight(const Factor& factor, const ReachedRows& rows, double* y,
                                          int stride, double* square) {
  constexpr int kStride = Parts * kLanes;
  Lanes sum[Parts] = {};
  for (int a = 0; a < rows.count; ++a) {
    const int k = rows.column[a] - rows.begin;
    Lanes row[Parts];
    for (int part = 0; part < Parts; ++part) {
      double* at = rows.x + k * kStride + part * kLanes;
      row[part] = load_lanes(at);
      store_lanes(Lanes{}, at);
    }
    for (int dof = factor.above[factor.dof_begin + k]; dof >= 0; dof = factor.above[dof]) {
      const int i = dof - factor.dof_begin;
      const double scale = -factor.entry[factor.row[k] + i];
      for (int part = 0; part < Parts; ++part) {
        double* at = rows.x + i * kStride + part * kLanes;
        store_lanes(load_lanes(at) + scale * row[part], at);
      }
    }
    for (int part = 0; part < Parts; ++part) {
      row[part] *= factor.inverse_root[k];
      sum[part] += row[part] * row[part];
    }
    for (int i = 0; i < rows.dim; ++i) y[i * stride + a] = row[i / kLanes][i % kLanes];
  }
  for (int i = 0; i < rows.dim; ++i) square[i] = sum[i / kLanes][i % kLanes];
}

DASHPOT_VECTOR_CLONES
void weight_rows(const Factor& factor, const ReachedRows& rows, double* y, int stride,
                 double* square) {
  if (rows.dim <= kLanes)
    weight<1>(factor, rows, y, stride, square);
  else
    weight<2>(factor, rows, y, stride, square);
}

}  // namespace

void append_mass_weighted(Rows& rows, RowGroup& c, const Trees& trees) {
  const int* column = rows.column.data() + c.column;
  for (int side = 0; side < 2; column += c.columns[side], ++side) {
    if (c.tree[side] < 0 || c.is_of_one_coordinate(side)) continue;
    const Tree& t = trees.tree[c.tree[side]];
    if (t.free_body) continue;
    MassWeighted& weighted = c.weighted[side];
    weighted.column = static_cast<int>(rows.weighted_column.size());
    weighted.count =
        append_reached(column, c.columns[side], t, trees.above.data(), rows.weighted_column);
    weighted.value = static_cast<int>(rows.weighted_value.size());
    rows.weighted_value.resize(weighted.value + c.dim * padded(weighted.count), 0.0);
  }
}

void weight_by_mass(Rows& rows, const RowGroup& c, int side, const Trees& trees,
                    double* inverse_mass) {
  static_assert(kMaxRows <= 2 * kLanes);
  const Tree& t = trees.tree[c.tree[side]];
  const int first = side == 0 ? 0 : c.columns[0], count = c.columns[side], width = c.width();
  const int* column = rows.column.data() + c.column + first;
  const double* value = rows.value.data() + c.value + first;
  const MassWeighted& weighted = c.weighted[side];
  // Rows of one coordinate after the other; zero between groups.
  thread_local AlignedDoubles kept;
  const int lanes = padded(c.dim);
  kept.resize(std::max<size_t>(kept.size(), t.dof_count * lanes), 0.0);
  double* const x = kept.data();
  for (int k = 0; k < count; ++k)
    for (int i = 0; i < c.dim; ++i) x[(column[k] - t.begin) * lanes + i] = value[i * width + k];
  const Factor factor{trees.factor.data() + t.inverse, trees.row_begin.data() + t.dof_begin,
                      trees.inverse_root.data() + t.begin, trees.above.data(), t.dof_begin};
  const ReachedRows reached{rows.weighted_column.data() + weighted.column, weighted.count, t.begin,
                            c.dim, x};
  weight_rows(factor, reached, rows.weighted_value.data() + weighted.value, padded(weighted.count),
              inverse_mass);
}

void weight_row(const Trees& trees, int tree, double* row) {
  const Tree& t = trees.tree[tree];
  const int *above = trees.above.data(), first = t.dof_begin, n = t.dof_count;
  for (int k = n - 1; k >= 0; --k) {
    if (row[k] == 0.0) continue;
    const double* entry = trees.factor.data() + t.inverse + trees.row_begin[first + k];
    for (int dof = above[first + k]; dof >= 0; dof = above[dof])
      row[dof - first] -= entry[dof - first] * row[k];
    row[k] *= trees.inverse_root[t.begin + k];
  }
}

void weight_motion(const Trees& trees, int tree, double* motion) {
  const Tree& t = trees.tree[tree];
  const int *above = trees.above.data(), first = t.dof_begin, n = t.dof_count;
  // What is above comes later, and is as it was.
  for (int k = n - 1; k >= 0; --k) {
    const double* entry = trees.factor.data() + t.inverse + trees.row_begin[first + k];
    double sum = motion[k];
    for (int dof = above[first + k]; dof >= 0; dof = above[dof])
      sum += entry[dof - first] * motion[dof - first];
    motion[k] = sum / trees.inverse_root[t.begin + k];
  }
}

void unweight_motion(const Trees& trees, int tree, double* motion) {
  const Tree& t = trees.tree[tree];
  const int *above = trees.above.data(), first = t.dof_begin, n = t.dof_count;
  for (int k = 0; k < n; ++k) {
    const double* entry = trees.factor.data() + t.inverse + trees.row_begin[first + k];
    double sum = motion[k] * trees.inverse_root[t.begin + k];
    for (int dof = above[first + k]; dof >= 0; dof = above[dof])
      sum -= entry[dof - first] * motion[dof - first];
    motion[k] = sum;
  }
}

}  // namespace dashpot
