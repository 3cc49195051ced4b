// The system of position_recovery.hpp over the rows of an island whose springs act:
//
//     d = inv(H) J' e ,   (A + R) e = t ,   A = J inv(H) J' .
//
// Where few coordinates move it is solved as
//
//     (H + J' inv(R) J) d = J' inv(R) t ,   e = inv(R) (t - J d)
//
// by Cholesky's factors, else by conjugate gradients for e, preconditioned by the diagonal of A +
// R.

#pragma once

#include <vector>

#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

struct Island;

class RecoverySystem {
 public:
  // Finds the rows that take part and their targets, which are within `reach` (m, rad), over `time`
  // (s). Rows, trees and island are to outlive its use.
  void reset(const Rows& rows, const Trees& trees, const Island& island, double reach, double time,
             const RowData& data);

  bool empty() const;  // whether nothing recovers
  const std::vector<int>& groups() const { return group_; }
  const std::vector<double>& target() const { return target_; }  // t, by row of these groups

  // Finds d, in the motion coordinates of the trees of the island.
  void solve(std::vector<double>& displacement);

  const std::vector<double>& shift() const { return shift_; }  // J d
  double square() const;                                       // d' H d

 private:
  void number_coordinates();
  void add_inertia(const Tree& tree);
  void add_rows();
  void find_columns(const RowGroup& group, int row);
  void factorize_and_solve(std::vector<double>& displacement);
  void iterate(std::vector<double>& displacement);
  void project(const std::vector<double>& displacement, std::vector<double>& out) const;
  void displace(const std::vector<double>& multiplier, std::vector<double>& displacement);
  void clear(std::vector<double>& motion) const;

  const Rows* rows_ = nullptr;
  const Trees* trees_ = nullptr;
  const Island* island_ = nullptr;
  std::vector<int> group_;
  // By row of these groups: t, R and 1 / diag(A + R), 0 of rows that take no part.
  std::vector<double> target_, softness_, scale_;
  std::vector<double> multiplier_, shift_;  // e, J d
  int size_ = 0;                            // coordinates that move
  std::vector<int> number_;                 // by motion coordinate, among those that move
  std::vector<double> matrix_, solution_;   // H + J' inv(R) J, its lower half; d
  std::vector<int> column_;                 // of a row, by number, and
  std::vector<double> entry_;               // its entries
  std::vector<double> impulse_;             // J' e
  std::vector<double> residual_, direction_, image_;
};

}  // namespace dashpot
