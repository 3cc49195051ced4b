// How rows of spatial tendons and of ranges of ball joints turn in a step.
//
// A string at its limit that keeps the direction of the start of the step lets what circles on it
// gain energy, as a contact frozen there does (detect/turning.hpp): W^2 H / 2 a second. So does
// the range of a ball joint, whose row is the axis that the joint has turned about. So limits have
// the row of the middle of the step, to which the velocities of its start lead, and equalities,
// which the Verlet corrector of the step corrects (trapezoid.hpp), their turning,
//
//     dJ/dt xi = (J(q + H/2 v) - J(q)) xi / (H/2) ,
//
// in motion coordinates. It holds along paths around wrapping geoms, too.
//
// The range of a ball joint keeps the row of the start where it is hit within the step, or left:
// the force of a moment would do work on what the row turns by before or after it. So it does where
// the row turns far, as that of a narrow range, or the joint does: what stops a thin body's spin,
// too, throws it elsewhere than velocities tell.

#pragma once

#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

// Keeps its arrays from step to step.
class RowTurns {
 public:
  // For the tendons that limits and equalities among `constraints` keep, and the ball joints whose
  // ranges are among them, over a step of `length` (s) that starts with the velocities `motion`, in
  // motion coordinates. Takes positions of `d`, and kinematics for tendons, to the middle and back.
  void find(const mjModel_* m, mjData_* d, double length, const Trees& trees, const double* motion,
            const std::vector<ConstraintInput>& constraints);
  // Rows that have the geometry of the middle do not turn.
  void forget() { turns_.clear(); }

  // d^2 L / dt^2 of a tendon while the motion coordinates keep their rates, m/s^2; 0 for others.
  double tendon_turning(int tendon) const { return turning(find_turn(-1, tendon)); }
  // The same of what a limit keeps: a tendon's length, or what is left of a ball joint's range.
  double limit_turning(const ConstraintInput& limit) const {
    return turning(find_turn(limit.ball, limit.tendon));
  }
  // Its row in the middle by degree of freedom, of free bodies over their centre of mass and in
  // world axes; null where it does not turn.
  const double* limit_in_the_middle(const ConstraintInput& limit) const {
    const Turn* turn = find_turn(limit.ball, limit.tendon);
    return turning(turn) != 0.0 ? rows_.data() + turn->row : nullptr;
  }
  double half_length() const { return half_length_; }

 private:
  struct Turn {
    int ball, tendon;  // the joint or the tendon, -1 for the other
    int row;           // first in rows_
    double gap;        // m or rad, of a limit
    double turning;
  };
  static double turning(const Turn* turn) { return turn ? turn->turning : 0.0; }
  const Turn* find_turn(int ball, int tendon) const;
  void add_turn(const mjModel_* m, int ball, int tendon, double gap);
  void read_rows(const mjModel_* m, const mjData_* d, const Trees& trees,
                 std::vector<double>& rows) const;

  std::vector<Turn> turns_;
  std::vector<double> rows_, start_, position_;
  double half_length_ = 0.0;
};

}  // namespace dashpot::host
