#include "dashpot/rows/sparse_inertia.hpp"

#include <Eigen/SparseCholesky>
#include <algorithm>

namespace dashpot {

namespace {

using Matrix = Eigen::SparseMatrix<double>;

}  // namespace

struct SparseInertia::Impl {
  // Whether the entries of `matrix` lie where those of `places` do, which are the matrix's places
  // from then on.
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
  if (!impl_->lies_as_before()) impl_->factors.analyzePattern(impl_->matrix);
  impl_->factors.factorize(impl_->matrix);
  return impl_->factors.info() == Eigen::Success && impl_->factors.vectorD().minCoeff() > 0.0;
}

void SparseInertia::add_solution(const double* f, double* x) const {
  const auto& factors = impl_->factors;
  const Eigen::Index n = impl_->matrix.cols();
  thread_local Eigen::VectorXd solution;  // a step allocates nothing
  solution.resize(n);
  const int* to = factors.permutationP().indices().data();
  for (Eigen::Index i = 0; i < n; ++i) solution[to[i]] = f[i];
  factors.matrixL().solveInPlace(solution);
  solution.array() /= factors.vectorD().array();
  factors.matrixU().solveInPlace(solution);
  for (Eigen::Index i = 0; i < n; ++i) x[i] += solution[to[i]];
}

}  // namespace dashpot
