// By how much rows that hold bodies rigidly together make a hit heavier.
//
// What a contact or limit is damped by, and so its restitution, goes by the inverse masses of its
// rows, which see one tree on each side. Equalities between trees, and limits that the hit presses,
// tie more to them. With the rows E of these, and the push f = J' x of the contacts of a pair that
// are compressed by x,
//
//     w = f' inv(H) f,      w_tied = w - a' inv(E inv(H) E') a,      a = E inv(H) f
//
// are the inverse masses without and with what is tied (Gauss's principle). Conjugate gradients
// solve the system: after k steps they know what is up to k rows away, and w_tied is no less.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class TiedMass {
 public:
  // Fills RowGroup::tied of the contacts and limits that move as fast as hits do, or are thrown
  // back, from the velocities in `data`. `compression`: x, by group (pressed_together.hpp).
  void find(const StepView& step, const std::vector<GroupMaterial>& materials, const Trees& trees,
            const std::vector<Island>& islands, const std::vector<double>& compression,
            const RowData& data, Rows& rows);

 private:
  // What one step and one of its islands are.
  struct Scene {
    const StepView& step;
    const Trees& trees;
    const Island& island;
    const std::vector<double>& compression;
    const RowData& data;
  };
  void find_in(const Scene& scene, Rows& rows);
  double tied(const Scene& scene, const Rows& rows, double speed);
  void push(const Scene& scene, const Rows& rows, const std::vector<int>& groups,
            const std::vector<double>& impulse);
  double work_of_push(const Scene& scene) const;
  double solve(const Scene& scene, const Rows& rows);

  std::vector<int> equality_, limit_;  // groups that hold, or may
  std::vector<int> hit_, held_;        // groups of a hit, and those that hold it
  std::vector<double> weight_;         // by hit_
  std::vector<double> rate_, impulse_, residual_, direction_, image_, scaled_;  // by held_
  AlignedDoubles force_, response_;
};

}  // namespace dashpot
