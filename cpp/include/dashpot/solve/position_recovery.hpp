// Recovery of equalities by displacement.
//
// Where the position of an equality row and the strain its spring remembers differ, the difference
// o (its unstressed penetration) is the error of geometry frozen over a step or of the initial
// state. A surface that moved back at some speed would push bodies at that speed: near a singular
// configuration, where little of the apparent mass moves along the row, that means fast bodies,
// whose turning makes the next error. A straight chain connected at both ends would gain energy
// without bound. Displacing the bodies instead gives them no velocity. With t the errors, limited
// to what the recovery speed covers in a step,
//
//     d = inv(H) J' e ,   (A + R) e = t ,   A = J inv(H) J' .
//
// For equalities R = max(w / 100, typical w - w), which keeps displacements small near singular
// configurations and where rows contradict each other. Springs of contacts, limits and sticking
// friction take part with t = 0 and resist as they would over a step of length H, R = 1 / (k H^2),
// so that recovery moves bodies along what holds them. All springs follow what the displacement
// does beyond t.
//
// It is solved as
//
//     (H + J' inv(R) J) d = J' inv(R) t ,   e = inv(R) (t - J d)
//
// by Cholesky's factors (rows/held_inertia.hpp), or, where these take longer, by conjugate
// gradients for e, preconditioned by the diagonal of A + R.

#pragma once

#include <vector>

#include "dashpot/rows/held_inertia.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

struct Island;

// That system over the rows of an island whose springs act.
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
  bool is_worth_factors() const;
  void factorize_and_solve(std::vector<double>& displacement);
  void iterate(std::vector<double>& displacement);
  void project(const std::vector<double>& displacement, std::vector<double>& out) const;
  void displace(const std::vector<double>& multiplier, std::vector<double>& displacement);
  void scatter_all(const std::vector<double>& multiplier, std::vector<double>& impulse) const;
  void clear(std::vector<double>& motion) const;

  const Rows* rows_ = nullptr;
  const Trees* trees_ = nullptr;
  const Island* island_ = nullptr;
  std::vector<int> group_;
  // By row of these groups: t, R and 1 / diag(A + R), 0 of rows that take no part.
  std::vector<double> target_, softness_, scale_;
  std::vector<double> multiplier_, shift_;  // e, J d
  std::vector<HeldRow> held_row_;           // those that take part
  HeldInertia held_;
  std::vector<double> impulse_;  // J' e
  std::vector<double> residual_, direction_, image_;
};

// The displacement of the trees of an island whose equalities have offsets, after its micro-steps
// over `time` (s), is added to `displacement` (zero there before; motion coordinates). Returns the
// energy that the springs of other rows took up by following it, J.
double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement);

}  // namespace dashpot
