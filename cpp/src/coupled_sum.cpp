#include "dashpot/coupled_sum.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/aligned.hpp"
#include "dashpot/instruction_sets.hpp"
#include "dashpot/lane_blocks.hpp"
#include "dashpot/lanes.hpp"

namespace dashpot {

namespace {

constexpr int kBodyLocal[6] = {0, 1, 2, 4, 5, 6};  // of the coordinates of a free body

// S += sum_i weight_i row_i' row_i over the rows of a pair for one body, whose linear rows are
// (n, a x n) with the arm a and whose angular rows are (0, n). Of the two mixed blocks, each the
// other's transpose, the one below the diagonal is added.
DASHPOT_VECTOR_CLONES
void add_pair(const PairGeometry& pair, int side, int dim, const double* weight, double* sum) {
  const auto column = [&](int j) { return sum + j * kBodyCoordinates; };
  Lanes linear[3], mixed[3], angular[3];
  for (int j = 0; j < 3; ++j) {
    linear[j] = load_lanes(column(j));
    mixed[j] = load_lanes(column(j) + 4);
    angular[j] = load_lanes(column(4 + j) + 4);
  }
  const double* a = pair.arm[side].data();
  for (int i = 0; i < dim; ++i) {
    const double* n = pair.frame.data() + 3 * (i % 3);
    const Lanes direction{n[0], n[1], n[2], 0.0};
    if (i >= 3) {
      for (int j = 0; j < 3; ++j) angular[j] += weight[i] * n[j] * direction;
      continue;
    }
    const double m[3] = {a[1] * n[2] - a[2] * n[1], a[2] * n[0] - a[0] * n[2],
                         a[0] * n[1] - a[1] * n[0]};
    const Lanes moment{m[0], m[1], m[2], 0.0};
    for (int j = 0; j < 3; ++j) {
      linear[j] += weight[i] * n[j] * direction;
      mixed[j] += weight[i] * n[j] * moment;
      angular[j] += weight[i] * m[j] * moment;
    }
  }
  for (int j = 0; j < 3; ++j) {
    store_lanes(linear[j], column(j));
    store_lanes(mixed[j], column(j) + 4);
    store_lanes(angular[j], column(4 + j) + 4);
  }
}

// c = a b of matrices with `count` rows, a multiple of four, of which the first n columns count.
DASHPOT_VECTOR_CLONES
void multiply(const double* a, const double* b, int n, int count, double* c) {
  for_each_block(
      count, [=](int first, auto width) __attribute__((always_inline)) {
        for (int j = 0; j < n; ++j) {
          Lanes sum[width()] = {};
          for (int k = 0; k < n; ++k) add_scaled(a + k * count + first, b[j * count + k], sum);
          store_block(sum, c + j * count + first);
        }
      });
}

// trace(B^8)^(1/8) for the 6x6 matrix B of a free body. Writes the mixed block above the diagonal
// into `sum`.
double body_bound(double* sum, const double* inverse) {
  constexpr int n = 6, count = 8;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      sum[(4 + i) * kBodyCoordinates + j] = sum[j * kBodyCoordinates + 4 + i];
  alignas(kCacheLine) double b[n * count] = {}, square[n * count], fourth[n * count];
  double trace = 0.0;
  for (int column = 0; column < n; ++column) {
    const double* s = sum + kBodyLocal[column] * kBodyCoordinates;
    double* to = b + column * count;
    for (int i = 0; i < 3; ++i) {
      to[i] = inverse[i] * s[i];
      to[3 + i] = inverse[4 + i] * s[4] + inverse[8 + i] * s[5] + inverse[12 + i] * s[6];
    }
    trace += to[column];
  }
  if (trace == 0.0) return 0.0;
  const double scale = 1.0 / trace;
  for (double& entry : b) entry *= scale;
  multiply(b, b, n, count, square);
  multiply(square, square, n, count, fourth);
  double eighth = 0.0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) eighth += fourth[i * count + j] * fourth[j * count + i];
  return trace * std::sqrt(std::sqrt(std::sqrt(eighth)));
}

// trace(B^4)^(1/4), B = inverse sum, of n x n matrices with columns `count` apart. `room`: for two
// such matrices.
double tree_bound(const double* sum, const double* inverse, int n, int count, double* room) {
  double* b = room;
  double* square = room + count * count;
  multiply(inverse, sum, n, count, b);
  double trace = 0.0;
  for (int i = 0; i < n; ++i) trace += b[i * (count + 1)];
  if (trace == 0.0) return 0.0;
  for (int i = 0; i < n * count; ++i) b[i] /= trace;
  multiply(b, b, n, count, square);
  double fourth = 0.0;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) fourth += square[i * count + j] * square[j * count + i];
  return trace * std::sqrt(std::sqrt(fourth));
}

// The entries of `matrix`, whose columns are `stride` apart, at the coordinates in `reached`, as a
// matrix with columns `count` apart, which is zero before.
void compress(const double* matrix, int stride, const std::vector<int>& reached, int count,
              double* compressed) {
  for (size_t j = 0; j < reached.size(); ++j)
    for (size_t i = 0; i < reached.size(); ++i)
      compressed[j * count + i] = matrix[reached[j] * stride + reached[i]];
}

}  // namespace

void CoupledSum::reset(const Trees& trees) {
  entry_.resize(trees.inverse.size(), 0.0);
  reaches_.resize(trees.coordinates, 0);
  empty_.assign(trees.tree.size(), 1);
  size_t largest = 0;
  for (const Tree& t : trees.tree)
    if (!t.free_body) largest = std::max<size_t>(largest, t.count);
  room_.resize(4 * largest * largest);
}

void CoupledSum::add(const Rows& rows, const Trees& trees, const RowGroup& c, int side, int dim,
                     const double* weight) {
  empty_[c.tree[side]] = 0;
  const Tree& t = trees.tree[c.tree[side]];
  double* sum = entry_.data() + t.inverse;
  if (c.pair >= 0) return add_pair(rows.pair[c.pair], side, dim, weight, sum);
  const int first = side == 0 ? 0 : c.columns[0], count = c.columns[side];
  const int* column = rows.column.data() + c.column + first;
  const double* value = rows.value.data() + c.value + first;
  const int width = c.width();
  for (int k = 0; k < count; ++k) {
    reaches_[column[k]] = 1;
    double scaled[kMaxRows];
    for (int i = 0; i < dim; ++i) scaled[i] = weight[i] * value[i * width + k];
    double* to = sum + (column[k] - t.begin) * t.count - t.begin;
    for (int l = 0; l < count; ++l) {
      double entry = to[column[l]];
      for (int i = 0; i < dim; ++i) entry += scaled[i] * value[i * width + l];
      to[column[l]] = entry;
    }
  }
}

// Of a tree rows may reach a part only, as the legs of a robot: the rest of B is zero.
double CoupledSum::bound_of_reached(const Tree& t, const double* inverse) {
  const double* sum = entry_.data() + t.inverse;
  reached_.clear();
  for (int i = 0; i < t.dof_count; ++i)
    if (reaches_[t.begin + i]) reached_.push_back(i);
  std::fill_n(reaches_.begin() + t.begin, t.count, 0);
  const int n = static_cast<int>(reached_.size());
  if (n == t.dof_count) return tree_bound(sum, inverse, n, t.count, room_.data());
  const int count = padded(n), size = count * count;
  std::fill_n(room_.data(), 4 * size, 0.0);
  compress(sum, t.count, reached_, count, room_.data() + 2 * size);
  compress(inverse, t.count, reached_, count, room_.data() + 3 * size);
  return tree_bound(room_.data() + 2 * size, room_.data() + 3 * size, n, count, room_.data());
}

double CoupledSum::take_bound(const Trees& trees, int tree) {
  if (empty_[tree]) return 0.0;
  const Tree& t = trees.tree[tree];
  double* sum = entry_.data() + t.inverse;
  const double* inverse = trees.inverse.data() + t.inverse;
  const double bound = t.free_body ? body_bound(sum, inverse) : bound_of_reached(t, inverse);
  std::fill_n(sum, t.count * t.count, 0.0);
  empty_[tree] = 1;
  return bound;
}

}  // namespace dashpot
