#include "dashpot/rows/sparse_inertia.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <type_traits>

namespace dashpot {

namespace {

using Matrix = Eigen::SparseMatrix<double>;

constexpr int kMostAlike = 3;

// Columns of a factor with the same rows below them, as those of the three directions of a vertex.
struct Alike {
  int first, count;
};

// What lies in `count` such columns, column after column: values among themselves, which come first
// in each, and those in the rows below.
template <int Count>
struct Columns {
  Columns(const Matrix& l, int first) {
    const int* begin = l.outerIndexPtr() + first;
    for (int k = 0; k < Count; ++k) {
      among[k] = l.valuePtr() + begin[k];
      below[k] = among[k] + Count - 1 - k;
    }
    row = l.innerIndexPtr() + begin[Count - 1];
    rows = begin[Count] - begin[Count - 1];
  }
  const double *among[Count], *below[Count];
  const int* row;
  int rows;
};

// x = inv(L) x, of these columns.
template <int Count>
void eliminate(const Matrix& l, int first, double* x) {
  const Columns<Count> columns(l, first);
  double own[Count];
  for (int k = 0; k < Count; ++k) {
    own[k] = x[first + k];
    for (int i = k + 1; i < Count; ++i) x[first + i] -= columns.among[k][i - k - 1] * own[k];
  }
  for (int p = 0; p < columns.rows; ++p) {
    double sum = 0.0;
    for (int k = 0; k < Count; ++k) sum += columns.below[k][p] * own[k];
    x[columns.row[p]] -= sum;
  }
}

// x = inv(L') x.
template <int Count>
void substitute(const Matrix& l, int first, double* x) {
  const Columns<Count> columns(l, first);
  double sum[Count] = {};
  for (int p = 0; p < columns.rows; ++p) {
    const double of_row = x[columns.row[p]];
    for (int k = 0; k < Count; ++k) sum[k] += columns.below[k][p] * of_row;
  }
  for (int k = Count - 1; k >= 0; --k) {
    for (int i = k + 1; i < Count; ++i) sum[k] += columns.among[k][i - k - 1] * x[first + i];
    x[first + k] -= sum[k];
  }
}

// Each column of L has the rows below its diagonal alone.
std::vector<Alike> alike_columns(const Matrix& l) {
  const int n = static_cast<int>(l.cols());
  const int *begin = l.outerIndexPtr(), *row = l.innerIndexPtr();
  const auto goes_on = [&](int column) {
    return begin[column + 1] - begin[column] == begin[column + 2] - begin[column + 1] + 1 &&
           row[begin[column]] == column + 1;
  };
  std::vector<Alike> alike;
  for (int i = 0; i < n; i += alike.back().count) {
    alike.push_back({i, 1});
    while (alike.back().count < kMostAlike && i + alike.back().count < n &&
           goes_on(i + alike.back().count - 1))
      ++alike.back().count;
  }
  return alike;
}

template <typename Visit>
void with_count(const Alike& of, const Visit& visit) {
  if (of.count == 3) return visit(std::integral_constant<int, 3>());
  if (of.count == 2) return visit(std::integral_constant<int, 2>());
  visit(std::integral_constant<int, 1>());
}

}  // namespace

struct SparseInertia::Impl {
  // Whether the entries of `matrix` lie where those of `places` do, which are its own from then on.
  bool lies_as_before() {
    const int count = static_cast<int>(matrix.nonZeros()), n = static_cast<int>(matrix.cols());
    const bool same =
        places.nonZeros() == count && places.cols() == n &&
        std::equal(matrix.outerIndexPtr(), matrix.outerIndexPtr() + n, places.outerIndexPtr()) &&
        std::equal(matrix.innerIndexPtr(), matrix.innerIndexPtr() + count, places.innerIndexPtr());
    if (!same) places = matrix;
    return same;
  }

  Matrix matrix, places;
  std::vector<Alike> alike;
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::SimplicialLDLT<Matrix, Eigen::Lower> factors;
};

SparseInertia::SparseInertia() : impl_(std::make_unique<Impl>()) {}
SparseInertia::~SparseInertia() = default;

bool SparseInertia::factor(int n, const std::vector<Entry>& lower) {
  impl_->entries.clear();
  for (const Entry& entry : lower)
    impl_->entries.emplace_back(entry.row, entry.column, entry.value);
  impl_->matrix.resize(n, n);
  impl_->matrix.setFromTriplets(impl_->entries.begin(), impl_->entries.end());
  const bool as_before = impl_->lies_as_before();
  if (!as_before) impl_->factors.analyzePattern(impl_->matrix);
  impl_->factors.factorize(impl_->matrix);
  if (impl_->factors.info() == Eigen::Success && (!as_before || impl_->alike.empty()))
    impl_->alike = alike_columns(impl_->factors.matrixL().nestedExpression());
  return impl_->factors.info() == Eigen::Success && impl_->factors.vectorD().minCoeff() > 0.0;
}

void SparseInertia::add_solution(const double* f, double* x) const {
  const auto& factors = impl_->factors;
  const Eigen::Index n = impl_->matrix.cols();
  thread_local Eigen::VectorXd solution;  // a step allocates nothing
  solution.resize(n);
  const int* to = factors.permutationP().indices().data();
  for (Eigen::Index i = 0; i < n; ++i) solution[to[i]] = f[i];
  const Matrix& l = factors.matrixL().nestedExpression();
  const std::vector<Alike>& alike = impl_->alike;
  for (auto of = alike.begin(); of != alike.end(); ++of)
    with_count(*of, [&](auto count) { eliminate<count()>(l, of->first, solution.data()); });
  solution.array() /= factors.vectorD().array();
  for (auto of = alike.rbegin(); of != alike.rend(); ++of)
    with_count(*of, [&](auto count) { substitute<count()>(l, of->first, solution.data()); });
  for (Eigen::Index i = 0; i < n; ++i) x[i] += solution[to[i]];
}

}  // namespace dashpot
