#include "dashpot/islands/coupled_sum.hpp"

#include <cmath>
#include <limits>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

namespace {

// S += sum_i weight_i row_i' row_i over the sparse rows of a free body.
void add_sparse(const Rows& rows, const RowGroup& c, int side, int begin, int dim, const Tree& t,
                const double* weight, BodySum& sum) {
  const int first = side == 0 ? 0 : c.columns[0], count = c.columns[side];
  const int* column = rows.column.data() + c.column + first;
  const int width = c.width();
  const double* value = rows.value.data() + c.value + begin * width + first;
  for (int i = 0; i < dim; ++i) {
    double row[kBodyCoordinates] = {};
    for (int k = 0; k < count; ++k) row[column[k] - t.begin] = value[i * width + k];
    add_row(row, weight[i], sum);
  }
}

// Rounds of the iteration for x, and the fraction of the bound that one takes off for another.
constexpr int kMostRounds = 8;
constexpr double kWorthwhile = 0.01;

// max_i (M x)_i / x_i of a symmetric matrix M of no negative entry, columns `count` apart, a
// multiple of four, for the best x of the power iteration x <- M x. Room for x and M x is given.
DASHPOT_VECTOR_CLONES
double perron_bound(const double* m, int n, int count, double* x, double* product) {
  std::fill_n(x, n, 1.0);
  double least = std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostRounds; ++round) {
    for_each_block(
        count, [=](int first, auto width) __attribute__((always_inline)) {
          Lanes sum[width()] = {};
          for (int k = 0; k < n; ++k) add_scaled(m + k * count + first, x[k], sum);
          store_block(sum, product + first);
        });
    double most = 0.0;
    for (int i = 0; i < n; ++i) most = std::max(most, product[i] / x[i]);
    const bool goes_on = most < (1.0 - kWorthwhile) * least && most > 0.0;
    least = std::min(least, most);
    if (!goes_on) break;
    // A row of zeros bounds nothing.
    for (int i = 0; i < n; ++i)
      if (product[i] > 0.0) x[i] = product[i] / most;
  }
  return least;
}

// S += sum_i weight_i y_i' y_i over the lower triangle, whose rows are `count` apart, at the
// columns of y, which fall.
DASHPOT_VECTOR_CLONES
void add_weighted(const double* y, int stride, const int* column, int columns, int begin, int dim,
                  const double* weight, double* sum, int count) {
  for (int a = 0; a < columns; ++a) {
    double* row = sum + (column[a] - begin) * count - begin;
    double scaled[kMaxRows];
    for (int i = 0; i < dim; ++i) scaled[i] = weight[i] * y[i * stride + a];
    for (int first = a / kLanes * kLanes; first < columns; first += kLanes) {
      Lanes entry{};
      for (int i = 0; i < dim; ++i) entry += scaled[i] * load_lanes(y + i * stride + first);
      for (int k = std::max(a, first); k < std::min(first + kLanes, columns); ++k)
        row[column[k]] += entry[k - first];
    }
  }
}

}  // namespace

void CoupledSum::Room::fit(const Trees& trees) {
  size_t largest = 0;
  for (const Tree& t : trees.tree)
    if (!t.free_body && !t.sparse) largest = std::max<size_t>(largest, t.count);
  matrix.resize(largest * largest);
  for (const Tree& t : trees.tree) largest = std::max<size_t>(largest, t.count);
  row.resize(largest);
  product.resize(largest);
}

void CoupledSum::reset(const Trees& trees) {
  body_.resize(trees.tree.size());
  rows_.resize(trees.tree.size());
  entry_.resize(trees.inverse.size(), 0.0);
  for (AlignedDoubles* sum : joint_sums()) sum->resize(trees.coordinates, 0.0);
  reaches_.resize(trees.coordinates, 0);
  empty_.assign(trees.tree.size(), 1);
  wide_.assign(trees.tree.size(), 0);
}

void CoupledSum::add(const Rows& rows, const Trees& trees, const RowGroup& c, int side, int first,
                     int dim, const double* weight) {
  const int tree = c.tree[side];
  const Tree& t = trees.tree[tree];
  empty_[tree] = 0;
  if (c.pair >= 0) return add_rows(rows.pair[c.pair], side, first, dim, weight, body_[tree]);
  if (t.free_body) return add_sparse(rows, c, side, first, dim, t, weight, body_[tree]);
  if (c.is_of_one_coordinate(side)) {
    const int index = side == 0 ? 0 : c.columns[0];
    const double value = rows.value[c.value + index];
    AlignedDoubles& sum = c.is_end_of_range ? end_[value > 0.0] : joint_;
    sum[rows.column[c.column + index]] += weight[0] * value * value;
    return;
  }
  wide_[tree] = 1;
  const MassWeighted& weighted = c.weighted[side];
  const int* column = rows.weighted_column.data() + weighted.column;
  const int stride = padded(weighted.count);
  for (int k = 0; k < weighted.count; ++k) reaches_[column[k]] = 1;
  if (t.sparse) {
    SparseRows& added = rows_[tree].emplace_back();
    added = {rows.weighted_value.data() + weighted.value + first * stride,
             column,
             weighted.count,
             stride,
             dim,
             {}};
    std::copy_n(weight, dim, added.weight.begin());
    return;
  }
  add_weighted(rows.weighted_value.data() + weighted.value + first * stride, stride, column,
               weighted.count, t.begin, dim, weight, entry_.data() + t.inverse, t.count);
}

void CoupledSum::add_contact(const Rows& rows, const Trees& trees, const RowGroup& c, int side,
                             const double* weight, CoupledSum& normal, CoupledSum& friction) {
  if (c.pair >= 0 && c.dim > 1) {
    const int tree = c.tree[side];
    normal.empty_[tree] = friction.empty_[tree] = 0;
    return dashpot::add_contact(rows.pair[c.pair], side, c.dim, weight, normal.body_[tree],
                                friction.body_[tree]);
  }
  CoupledSum& first = c.kind == RowKind::kSlider ? friction : normal;
  first.add(rows, trees, c, side, 0, 1, weight);
  if (c.dim > 1) friction.add(rows, trees, c, side, 1, c.dim - 1, weight + 1);
}

// Rows of one coordinate each: B has the eigenvalues of C = K^1/2 inv(H) K^1/2, K = diag(joint).
double CoupledSum::bound_of_joints(const Trees& trees, const Tree& t, Room& room) {
  const double* inverse = trees.inverse.data() + t.inverse;
  room.reached.clear();
  for (int i = 0; i < t.dof_count; ++i)
    if (of_joint(t.begin + i) != 0.0) room.reached.push_back(i);
  const int n = static_cast<int>(room.reached.size()), count = padded(n);
  for (int i = 0; i < n; ++i) room.row[i] = std::sqrt(of_joint(t.begin + room.reached[i]));
  for (int i = 0; i < n; ++i) {
    double* row = room.matrix.data() + i * count;
    for (int j = 0; j < n; ++j)
      row[j] = room.row[i] * room.row[j] *
               std::abs(inverse[room.reached[i] * t.count + room.reached[j]]);
    std::fill(row + n, row + count, 0.0);
  }
  return perron_bound(room.matrix.data(), n, count, room.row.data(), room.product.data());
}

// Makes the rows of one coordinate each a part of S.
void CoupledSum::add_joints(const Trees& trees, const Tree& t, Room& room) {
  const double* factor = trees.factor.data() + t.inverse;
  const double* inverse_root = trees.inverse_root.data() + t.begin;
  double* sum = entry_.data() + t.inverse;
  const int n = t.dof_count;
  for (int k = 0; k < n; ++k) {
    const double weight = of_joint(t.begin + k);
    if (weight == 0.0) continue;
    for (AlignedDoubles* joint_sum : joint_sums()) (*joint_sum)[t.begin + k] = 0.0;
    room.reached.clear();
    for (int dof = t.dof_begin + k; dof >= 0; dof = trees.above[dof])
      room.reached.push_back(dof - t.dof_begin);
    const int count = static_cast<int>(room.reached.size());
    double* y = room.row.data();
    std::fill_n(y, count, 0.0);
    y[0] = 1.0;
    for (int a = 0; a < count; ++a) {
      const double* row = factor + room.reached[a] * n;
      for (int b = a + 1; b < count; ++b) y[b] -= row[room.reached[b]] * y[a];
      y[a] *= inverse_root[room.reached[a]];
    }
    for (int a = 0; a < count; ++a) {
      reaches_[t.begin + room.reached[a]] = 1;
      double* row = sum + room.reached[a] * t.count;
      for (int b = a; b < count; ++b) row[room.reached[b]] += weight * y[a] * y[b];
    }
  }
}

// Of a tree rows may reach a part only, as the legs of a robot: the rest of S is zero.
double CoupledSum::bound_of_reached(const Trees& trees, const Tree& t, Room& room) {
  add_joints(trees, t, room);
  const double* sum = entry_.data() + t.inverse;
  room.reached.clear();
  for (int i = 0; i < t.dof_count; ++i)
    if (reaches_[t.begin + i]) room.reached.push_back(i);
  const int n = static_cast<int>(room.reached.size()), count = padded(n);
  for (int i = 0; i < n; ++i) {
    const double* row = sum + room.reached[i] * t.count;
    for (int j = 0; j <= i; ++j)
      room.matrix[i * count + j] = room.matrix[j * count + i] = std::abs(row[room.reached[j]]);
    std::fill(room.matrix.data() + i * count + n, room.matrix.data() + (i + 1) * count, 0.0);
  }
  return perron_bound(room.matrix.data(), n, count, room.row.data(), room.product.data());
}

// Rows of one coordinate each come on top, each tree of the model by itself.
double CoupledSum::bound_of_sparse(const Trees& trees, int tree, Room& room) {
  const Tree& t = trees.tree[tree];
  double of_joints = 0.0, sum = 0.0;
  for (int i = 0; i < t.dof_count; ++i) {
    if (trees.above[t.dof_begin + i] < 0) sum = 0.0;
    const double weight = of_joint(t.begin + i);
    if (weight != 0.0) sum += weight * inverse_diagonal(trees, tree, i);
    of_joints = std::max(of_joints, sum);
  }
  double *x = room.row.data() - t.begin, *product = room.product.data() - t.begin;
  std::fill_n(x + t.begin, t.count, 1.0);
  double least = rows_[tree].empty() ? 0.0 : std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostRounds && least > 0.0; ++round) {
    std::fill_n(product + t.begin, t.count, 0.0);
    for (const SparseRows& rows : rows_[tree])
      for (int i = 0; i < rows.dim; ++i) {
        const double* y = rows.y + i * rows.stride;
        double along = 0.0;
        for (int k = 0; k < rows.count; ++k) along += std::abs(y[k]) * x[rows.column[k]];
        along *= rows.weight[i];
        for (int k = 0; k < rows.count; ++k) product[rows.column[k]] += std::abs(y[k]) * along;
      }
    double most = 0.0;
    for (int i = t.begin; i < t.begin + t.count; ++i) most = std::max(most, product[i] / x[i]);
    const bool goes_on = most < (1.0 - kWorthwhile) * least && most > 0.0;
    least = std::min(least, most);
    if (!goes_on) break;
    for (int i = t.begin; i < t.begin + t.count; ++i)
      if (product[i] > 0.0) x[i] = product[i] / most;
  }
  return of_joints + least;
}

double CoupledSum::bound(const Trees& trees, int tree, Room& room) {
  const Tree& t = trees.tree[tree];
  if (empty_[tree]) return 0.0;
  if (t.free_body) return bound_of_body(body_[tree], trees.inverse.data() + t.inverse);
  if (t.sparse) return bound_of_sparse(trees, tree, room);
  return wide_[tree] ? bound_of_reached(trees, t, room) : bound_of_joints(trees, t, room);
}

void CoupledSum::clear(const Trees& trees, int tree) {
  if (empty_[tree]) return;
  const Tree& t = trees.tree[tree];
  empty_[tree] = 1;
  body_[tree] = {};
  if (t.free_body) return;
  rows_[tree].clear();
  for (int i = 0; i < t.dof_count && !t.sparse; ++i)
    if (reaches_[t.begin + i]) std::fill_n(entry_.data() + t.inverse + i * t.count, i + 1, 0.0);
  for (AlignedDoubles* sum : joint_sums()) std::fill_n(sum->data() + t.begin, t.count, 0.0);
  std::fill_n(reaches_.begin() + t.begin, t.count, 0);
  wide_[tree] = 0;
}

double CoupledSum::take_bound(const Trees& trees, int tree, Room& room) {
  const double result = bound(trees, tree, room);
  clear(trees, tree);
  return result;
}

double CoupledSum::replace(const Trees& trees, int tree, CoupledSum& to, Room& room) {
  const double result = bound(trees, tree, room);
  if (empty_[tree]) return result;
  to.empty_[tree] = 0;
  add_sum(body_[tree], to.body_[tree]);
  const Tree& t = trees.tree[tree];
  const auto add_range = [](const auto& from, int begin, int count, auto& sum) {
    for (int i = begin; i < begin + count; ++i) sum[i] += from[i];
  };
  if (!t.free_body)
    for (size_t i = 0; i < joint_sums().size(); ++i)
      add_range(*joint_sums()[i], t.begin, t.count, *to.joint_sums()[i]);
  for (int i = 0; i < t.dof_count; ++i) {
    if (t.sparse || !reaches_[t.begin + i]) continue;
    add_range(entry_, t.inverse + i * t.count, i + 1, to.entry_);
    to.reaches_[t.begin + i] = 1;
  }
  to.wide_[tree] |= wide_[tree];
  to.rows_[tree].insert(to.rows_[tree].end(), rows_[tree].begin(), rows_[tree].end());
  clear(trees, tree);
  return result;
}

}  // namespace dashpot
