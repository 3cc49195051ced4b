// Work of the rows on trees that RK4 moves.
//
// Micro-steps start from velocities v0 under the smooth forces f0 of the start of the step. Rows of
// impulse p take a tree to a velocity v1 and by x, and are booked with
//
//     p (v0 + v1) / 2  +  f0 (H (v0 + v1) / 2 - x) .
//
// The tree has its velocity u from the stages, in which forces r_i of the rows act: p / H and what
// they bar with (held_stages.hpp). It goes the way x', b beyond that of its stages. On b act the
// smooth forces f, whose work is booked or in the potential, and inertia changes. So rows gave
//
//     H sum w_i r_i v_i  -  f b  +  u'C(b, u),    b = x' - H sum w_i v_i,
//
// f being without the bias, and C(u, u) the Coriolis and centrifugal forces, a bilinear form: along
// b, u'M u / 2 changes by u'C(b, u). Where stages have the mean force P / H of springs beside that
// of the start (held_stages.hpp), micro-steps book P (v0 + v1) / 2 more, and rows gave P sum w_i
// v_i more. What rows are booked with beyond what they gave they have dissipated. With it the
// ledger closes to the order of RK4 where dry friction acts on velocities that change, and to
// second order in what a tree turns by where an impact sends it farther, or less far, than its mean
// force does in the stages.

#pragma once

#include <vector>

#include "dashpot/mujoco/runge_kutta.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Keeps its arrays from step to step.
class StageWork {
 public:
  // After a step from `start_velocity` (nv) that has just been integrated, `beyond`: b by degree of
  // freedom, zero of trees that RK4 has not moved.
  void find(const mjModel_* m, mjData_* d, const RungeKutta& stages,
            const std::vector<double>& start_velocity, const std::vector<double>& beyond);

  // By degree of freedom, what rows gave (J); it counts as the sum over those of a tree.
  const std::vector<double>& of_rows() const { return of_rows_; }

 private:
  void add_change_of_inertia(const mjModel_* m, mjData_* d,
                             const std::vector<double>& start_velocity,
                             const std::vector<double>& beyond);

  std::vector<double> of_rows_, velocity_;
  std::vector<double> bias_ahead_, bias_behind_;  // c(u + b / H), c(u - b / H)
};

}  // namespace dashpot::host
