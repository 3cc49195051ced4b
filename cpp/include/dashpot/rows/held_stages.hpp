// What rows leave of the stages of RK4 to trees that they hold.
//
// Along the rows that hold a tree at the end of a step (holding_rows.hpp) it moves as its
// micro-steps did, in every stage: with their mean acceleration, and at where they have taken it
// beyond what that explains, as a foot sinks in under a new load. What a stage's own acceleration
// differs by from the mean one is left across the rows, which act on it through M as all forces of
// stages do. (Through M + H D / 2, the inertia of the micro-steps, the damper of a leg took more of
// its swing by a fraction k H^2 / 4 m, k of its spring and m of its foot.)
//
// What rows throw back within a moment goes another way than under their mean force, under which
// stages see it. So linear springs of joints have in all stages of a tree that rows move the mean
// force that they had in its micro-steps (microstep.hpp): of each
//
//     P / H + k (q - q0)
//
// is added to what a stage finds of it, P: impulse of its pull, q - q0: way to the stage. (With
// their own force in every stage an elastic hit on a rigid floor gave a foot 8 % of its energy.)

#pragma once

#include <vector>

#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/holding_rows.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class HeldStages {
 public:
  // After the micro-steps of a step of `length` (s), of trees whose factor is that of M. By motion
  // coordinate: `start`, velocities at its start; `added`, what trapezoid.hpp has added to them,
  // null: nothing. `moved`, by tree: rows that have a position moved it.
  void find(const Rows& rows, const RowData& data, const Trees& trees, const AlignedDoubles& start,
            const double* added, const std::vector<char>& moved, double length);

  // Takes what rows bar from the accelerations (nv) of a stage, which has `weight` in the mean.
  void bar(std::vector<double>& acceleration, double weight);
  // Adds to `impulse`, by row, what those of a tree bore by it in the step.
  void add_borne(int tree, std::vector<double>& impulse) {
    rows_.add_borne(tree, length_, impulse);
  }
  // How far rows have taken trees beyond their mean acceleration, by degree of freedom; zeros for
  // those that none holds, or that have landed in this step.
  const std::vector<double>& way() const { return way_; }

  // Whether springs have their mean force, of any tree or of one, and what is added of it, by
  // degree of freedom, to what a stage finds after a `way`.
  bool have_mean_springs() const { return have_springs_; }
  bool has_mean_springs(int tree) const { return have_springs_ && springs_[tree]; }
  double spring_change(int dof, double way) const {
    return mean_pull_[dof] + stiffness_[dof] * way;
  }

  bool hold(int tree) const { return rows_.hold(tree); }
  // What rows leave of the inverse mass of degree of freedom i of a tree.
  double free_inverse_mass(int tree, int i) const {
    return rows_.free_inverse_mass(*trees_, tree, i);
  }

 private:
  // Trees that have come into a row within the step: where in it is not known.
  void find_landed(const Rows& rows, const RowData& data);
  void find_mean_springs(const RowData& data, const std::vector<char>& moved);

  const Trees* trees_ = nullptr;
  double length_ = 0.0;
  HoldingRows rows_;
  std::vector<double> mean_acceleration_, way_;  // by degree of freedom
  std::vector<char> lands_;                      // by tree
  bool have_springs_ = false;
  std::vector<char> springs_;                  // by tree: have their mean force
  std::vector<double> mean_pull_, stiffness_;  // by degree of freedom
  std::vector<double> change_;                 // of one tree
};

}  // namespace dashpot
