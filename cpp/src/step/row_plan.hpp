// How the rows of a substep are solved: which islands they form, what hits, presses or stays open
// in them, and from that their stiffness and micro-steps.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/islands/tied_mass.hpp"
#include "dashpot/law/parameters.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"
#include "dashpot/rows/trees.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class RowPlan {
 public:
  // Connected sets of groups, which the complementarity-free law needs alone.
  void find_islands(const Rows& rows, const Trees& trees) { islands_.find(rows, trees); }

  // Fills in the stiffness and damping of `rows`, whose `materials`, by group, are read at the load
  // that they bear. `resolved`: length (s) of the step that stiffness is resolved for.
  void find(const mjModel_* model, const StepView& step, const Trees& trees, const Options& options,
            double resolved, const HitFrequency& hit_frequency, Rows& rows,
            std::vector<GroupMaterial>& materials, RowData& data, Team& team);

  const std::vector<Island>& islands() const { return islands_.all(); }

 private:
  Islands islands_;
  TiedMass tied_mass_;
  // By group.
  std::vector<DeflectionTime> deflection_times_;
  std::vector<char> stays_open_;
  std::vector<double> compression_;
};

}  // namespace dashpot
