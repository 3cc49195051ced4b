// By how much rows that hold bodies rigidly together make a hit heavier.
//
// What a contact or limit is damped by, and so its restitution, goes by the inverse masses of its
// rows, which see one tree on each side. Equalities between trees, and limits that the hit presses,
// tie more to them. E are the rows of these, and f = J' x is the push of the contacts between two
// bodies that are compressed by x. The inverse masses without and with what is tied are
//
//     w = f' inv(H) f,      w_tied = f' inv(H + E' inv(R) E) f
//
// with next to no compliance R: by factors (rows/held_inertia.hpp) or, where few rows hold, by
// their own inverse masses E inv(H) E' + R.

#pragma once

#include <array>
#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/held_inertia.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class TiedMass {
 public:
  // Fills RowGroup::tied of the contacts and limits that move as fast as hits do, or are thrown
  // back, from the velocities in `data`; not of those on a model's own solref, which has a damping
  // of its own. `compression`: x, by group (modal_damping.hpp).
  void find(const StepView& step, const std::vector<GroupMaterial>& materials, const Trees& trees,
            const std::vector<Island>& islands, const std::vector<double>& compression,
            const RowData& data, Rows& rows);

 private:
  // What one step and one of its islands are.
  struct Scene {
    const StepView& step;
    const std::vector<GroupMaterial>& materials;
    const Trees& trees;
    const Island& island;
    const std::vector<double>& compression;
    const RowData& data;
  };
  void find_in(const Scene& scene, Rows& rows);
  double tied(const Scene& scene, const Rows& rows, double speed);
  void push(const Scene& scene, const Rows& rows);
  void clear(const Scene& scene, AlignedDoubles& values) const;
  void respond(const Scene& scene, const AlignedDoubles& force, AlignedDoubles& response) const;
  double work_of_push(const Scene& scene) const;
  bool hold(const Scene& scene, const Rows& rows);
  bool hold_with_few(const Scene& scene, const Rows& rows);

  static constexpr int kFewHeld = 16;
  std::array<const AlignedDoubles*, kFewHeld> respond_to_held(const Scene& scene, const Rows& rows);

  std::vector<int> equality_, limit_;  // groups that hold, or may
  std::vector<int> hit_, held_;        // groups of a hit, and those that hold it
  std::vector<int> factored_;          // held_ of which the factors of the island are
  std::vector<int> responded_;         // groups whose responses are known
  std::vector<HeldRow> held_row_;
  HeldInertia inertia_;
  AlignedDoubles force_, response_, pushed_, row_force_;
  std::array<AlignedDoubles, kFewHeld> row_response_;  // of responded_
};

}  // namespace dashpot
