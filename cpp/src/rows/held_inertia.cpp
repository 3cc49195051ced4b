#include "dashpot/rows/held_inertia.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

namespace {

// How many times the rows of a tree in the mean reach one that comes last.
constexpr double kMany = 3.0;

[[gnu::always_inline]] inline double sum_of(const Lanes& lanes) {
  return lanes[0] + lanes[1] + lanes[2] + lanes[3];
}

// Cholesky's factor of a matrix in the place of its lines, each from a multiple of four on, with
// zeros from its diagonal on, the inverse of which is in an array of its own, as its square root is
// asked for. The diagonal of the matrix is there before.
DASHPOT_VECTOR_CLONES
bool factor_lines(double* entry, const int* start, const int* first, int n, double* diagonal) {
  for (int i = 0; i < n; ++i) {
    double* line = entry + start[i] - first[i];
    Lanes square{};
    for (int j = first[i]; j < i; ++j) {
      const double* other = entry + start[j] - first[j];
      Lanes sum{};
      for (int k = std::max(first[i], first[j]); k < j; k += kLanes)
        sum += load_lanes(line + k) * load_lanes(other + k);
      line[j] = (line[j] - sum_of(sum)) * diagonal[j];
    }
    for (int k = first[i]; k < i; k += kLanes)
      square += load_lanes(line + k) * load_lanes(line + k);
    const double rest = diagonal[i] - sum_of(square);
    if (!(rest > 0.0)) return false;
    diagonal[i] = 1.0 / std::sqrt(rest);
  }
  return true;
}

DASHPOT_VECTOR_CLONES
void solve_lines(const double* entry, const int* start, const int* first, int n,
                 const double* diagonal, double* x) {
  for (int i = 0; i < n; ++i) {
    const double* line = entry + start[i] - first[i];
    Lanes sum{};
    for (int k = first[i]; k < i; k += kLanes) sum += load_lanes(line + k) * load_lanes(x + k);
    x[i] = (x[i] - sum_of(sum)) * diagonal[i];
  }
  for (int i = n - 1; i >= 0; --i) {
    const double* line = entry + start[i] - first[i];
    x[i] *= diagonal[i];
    for (int k = first[i]; k < i; k += kLanes)
      store_lanes(load_lanes(x + k) - load_lanes(line + k) * x[i], x + k);
  }
}

}  // namespace

void HeldInertia::reset(const Rows& rows, const Trees& trees, const int* first, const int* last,
                        const std::vector<HeldRow>& held) {
  rows_ = &rows;
  trees_ = &trees;
  tree_.assign(first, last);
  number(trees, held);
  first_.resize(size_);
  for (int tree : tree_) {
    const Tree& t = trees.tree[tree];
    const int begin = number_[t.begin];
    for (int i = 0; i < t.dof_count; ++i) {
      const int dof = t.dof_begin + i, end = trees.path_begin[dof + 1];
      const int top = trees.path_begin[dof] < end ? trees.path[end - 1] : i;
      first_[begin + i] = begin + (t.free_body ? 0 : top);
    }
  }
  read_rows(held);
  for (size_t row = 0; row < stiffness_.size(); ++row) {
    const auto from = column_.begin() + row_begin_[row], to = column_.begin() + row_begin_[row + 1];
    if (from == to) continue;
    const int least = *std::min_element(from, to);
    std::for_each(from, to, [&](int i) { first_[i] = std::min(first_[i], least); });
  }
  start_.resize(size_ + 1);
  start_[0] = 0;
  for (int i = 0; i < size_; ++i) {
    first_[i] = first_[i] / kLanes * kLanes;
    start_[i + 1] = start_[i] + padded(i + 1) - first_[i];
  }
}

void HeldInertia::number(const Trees& trees, const std::vector<HeldRow>& held) {
  reached_by_.assign(trees.tree.size(), 0);
  for (const HeldRow& row : held)
    for (int tree : rows_->group[row.group].tree)
      if (tree >= 0) ++reached_by_[tree];
  const double many = kMany * 2.0 * held.size() / std::max<size_t>(tree_.size(), 1);
  std::stable_partition(tree_.begin(), tree_.end(),
                        [&](int tree) { return reached_by_[tree] <= many; });
  number_.resize(trees.coordinates);
  coordinate_.clear();
  for (int tree : tree_) {
    const Tree& t = trees.tree[tree];
    for (int i = 0; i < t.dof_count; ++i) {
      number_[coordinate_of(t, i)] = static_cast<int>(coordinate_.size());
      coordinate_.push_back(coordinate_of(t, i));
    }
  }
  size_ = static_cast<int>(coordinate_.size());
}

// Over the coordinates that move.
void HeldInertia::read_rows(const std::vector<HeldRow>& held) {
  column_.clear();
  value_.clear();
  stiffness_.clear();
  row_begin_.assign(1, 0);
  const auto append = [&](int coordinate, double value) {
    column_.push_back(number_[coordinate]);
    value_.push_back(value);
  };
  for (const HeldRow& row : held) {
    const RowGroup& c = rows_->group[row.group];
    for (int k = 0; c.pair < 0 && k < c.columns[0] + c.columns[1]; ++k)
      append(rows_->column[c.column + k], rows_->value[c.value + row.of_group * c.width() + k]);
    for (int side = 0; c.pair >= 0 && side < 2; ++side) {
      const PairGeometry& pair = rows_->pair[c.pair];
      if (pair.begin[side] == 0) continue;
      const std::array<double, 6> values = pair_row(pair, row.of_group, side);
      for (int k = 0; k < 6; ++k) append(pair.begin[side] + (k < 3 ? k : k + 1), values[k]);
    }
    stiffness_.push_back(1.0 / row.compliance);
    row_begin_.push_back(static_cast<int>(column_.size()));
  }
}

double HeldInertia::work() const {
  double sum = 0.0;
  for (int i = 0; i < size_; ++i) sum += double(i - first_[i]) * (i - first_[i]);
  return sum;
}

void HeldInertia::add_inertia(const Tree& t) {
  const int begin = number_[t.begin];
  if (t.free_body) {
    const double* inverse = trees_->inverse.data() + t.inverse;
    for (int i = 0; i < 3; ++i) inverse_root_[begin + i] += 1.0 / inverse[i];
    const Eigen::Map<const Eigen::Matrix3d, 0, Eigen::OuterStride<4>> rotational(inverse + 4);
    const Eigen::Matrix3d inertia = rotational.inverse();
    for (int i = 0; i < 3; ++i) {
      inverse_root_[begin + 3 + i] += inertia(i, i);
      for (int j = 0; j < i; ++j) entry(begin + 3 + i, begin + 3 + j) += inertia(i, j);
    }
    return;
  }
  // L' D L: of each row of L what it couples, itself and those above it.
  const double* factor = trees_->factor.data() + t.inverse;
  const int* above = trees_->above.data() + t.dof_begin;
  const auto next = [&](int i) { return above[i] < 0 ? -1 : above[i] - t.dof_begin; };
  for (int k = 0; k < t.dof_count; ++k) {
    const double* row = factor + trees_->row_begin[t.dof_begin + k];
    const auto of = [&](int i) { return i == k ? 1.0 : row[i]; };
    for (int i = k; i >= 0; i = next(i)) {
      inverse_root_[begin + i] += row[k] * of(i) * of(i);
      for (int j = next(i); j >= 0; j = next(j))
        entry(begin + i, begin + j) += row[k] * of(i) * of(j);
    }
  }
}

bool HeldInertia::factor() {
  entry_.assign(start_[size_], 0.0);
  inverse_root_.assign(size_, 0.0);
  solution_.resize(padded(size_));
  for (int tree : tree_) add_inertia(trees_->tree[tree]);
  for (size_t row = 0; row < stiffness_.size(); ++row)
    for (int a = row_begin_[row]; a < row_begin_[row + 1]; ++a) {
      const double weighted = stiffness_[row] * value_[a];
      inverse_root_[column_[a]] += weighted * value_[a];
      for (int b = row_begin_[row]; b < a; ++b) {
        const auto [left, below] = std::minmax(column_[a], column_[b]);
        entry(below, left) += weighted * value_[b];
      }
    }
  return factor_lines(entry_.data(), start_.data(), first_.data(), size_, inverse_root_.data());
}

void HeldInertia::solve(const double* force, double* motion) {
  for (int i = 0; i < size_; ++i) solution_[i] = force[coordinate_[i]];
  std::fill(solution_.begin() + size_, solution_.end(), 0.0);
  solve_lines(entry_.data(), start_.data(), first_.data(), size_, inverse_root_.data(),
              solution_.data());
  for (int i = 0; i < size_; ++i) motion[coordinate_[i]] = solution_[i];
}

}  // namespace dashpot
