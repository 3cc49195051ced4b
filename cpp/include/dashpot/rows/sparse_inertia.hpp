// Effective inertia of a tree of many bodies that springs couple, as those of a flex: sparse,
// factored by Eigen in an order that fills in little and stays while entries lie where they did.

#pragma once

#include <memory>
#include <vector>

namespace dashpot {

class SparseInertia {
 public:
  // One of the lower triangle; those of one place add up.
  struct Entry {
    int row, column;
    double value;
  };

  SparseInertia();
  ~SparseInertia();

  // Factors the sum of the entries of n rows; false where it is not positive definite.
  bool factor(int n, const std::vector<Entry>& lower);
  // x += inv(H) f.
  void add_solution(const double* f, double* x) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dashpot
