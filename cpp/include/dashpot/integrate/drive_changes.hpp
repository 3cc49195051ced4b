// How forces of actuators, and those that users apply, change from step to step, and what of that
// goes into the Verlet corrector of a step (trapezoid.hpp, with the symbols).
//
// Most follow from the motion: position servos, and controllers that are asked once a step. Held
// over a step they would gain energy as springs do, from omega^2 H / 4. So a' has their change
//
//     e' - (e - D0 (v1 - v0)),
//
// D0: what the micro-steps follow of dampers and servos with implicit integrators.
//
// Where no s near 1 is left with it, they are taken as held after all, as servos of light fingers
// that hold something heavy.
//
// Forces may also jump, as commands do. A jump is held, as MuJoCo holds it: a push of n steps gives
// n e H. Apart from what servos change by because joints move, it is what two changes, one after
// the other, differ by, where that is much. But where a force falls at once that was followed on
// its way up, that much is followed down: of any course it is half a step of its largest value, at
// most, that is left of the halves.

#pragma once

#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class DriveChanges {
 public:
  // At the start of a step: e, of which no change is known. `velocity`: generalized.
  void start(const mjModel_* model, const mjData_* d, const std::vector<double>& velocity);
  // Finds by what e of trees with `left_corrector` (by tree) has changed since the step `before`.
  void find(const mjModel_* model, const mjData_* d, const HeldMotion& before, const Trees& trees,
            const std::vector<char>& left_corrector);
  // Of what is followed, counts the part s of a tree.
  void count_followed(const Tree& tree, double s);
  // Keeps a tree's for the next step, which starts with the generalized `velocity`, from a step
  // that started with `before`.
  void keep(const mjModel_* model, const Trees& trees, int tree, const double* before,
            const double* velocity, HeldMotion& now) const;

  // By degree of freedom: the change that is followed, and its part in servos because joints moved.
  double followed_change(int dof) const { return followed_change_[dof]; }
  double servo_change(int dof) const { return servo_change_[dof]; }

 private:
  // By degree of freedom: e of this step; of its change since the last one, what servos have
  // because joints moved, the rest, what of both is followed, and of the rest so far.
  std::vector<double> drive_, servo_change_, commanded_change_, followed_change_, followed_;
};

}  // namespace dashpot
