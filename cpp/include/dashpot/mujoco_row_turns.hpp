// How rows of spatial tendons turn in a step. Part of the mujoco_host room.
//
// A string at its limit that keeps the direction of the start of the step lets what circles on it
// gain energy, as a contact frozen there does (mujoco_turning.hpp): W^2 H / 2 a second. So limits
// have the row of the middle of the step, to which the velocities of its start lead, and
// equalities, which the second half of the step corrects (trapezoid.hpp), their turning,
//
//     dJ/dt xi = (J(q + H/2 v) - J(q)) xi / (H/2) ,
//
// in motion coordinates. It holds along paths around wrapping geoms, too.

#pragma once

#include <vector>

#include "dashpot/rows.hpp"
#include "dashpot/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Keeps its arrays from step to step.
class RowTurns {
 public:
  // For the tendons that limits and equalities among `constraints` keep, over a step of `length`
  // (s) that starts with the velocities `motion`, in motion coordinates. Takes the kinematics of
  // `d` to the middle and back.
  void find(const mjModel_* m, mjData_* d, double length, const Trees& trees, const double* motion,
            const std::vector<ConstraintInput>& constraints);
  // Rows that have the geometry of the middle do not turn.
  void forget() { turns_.clear(); }

  // d^2 L / dt^2 of a tendon while the motion coordinates keep their rates, m/s^2; 0 for others.
  double tendon_turning(int tendon) const {
    const Turn* turn = find_turn(tendon);
    return turn ? turn->turning : 0.0;
  }
  // Its row in the middle by degree of freedom, of free bodies over their centre of mass and in
  // world axes; null where it does not turn.
  const double* middle(int tendon) const {
    const Turn* turn = find_turn(tendon);
    return turn && turn->turning != 0.0 ? rows_.data() + turn->row : nullptr;
  }
  double half_length() const { return half_length_; }

 private:
  struct Turn {
    int tendon;
    int row;  // first in rows_
    double turning;
  };
  const Turn* find_turn(int tendon) const;
  void read_row(const mjModel_* m, const mjData_* d, const Trees& trees, int tendon, double* row);

  std::vector<Turn> turns_;
  std::vector<double> rows_, start_, position_;
  double half_length_ = 0.0;
};

}  // namespace dashpot::host
