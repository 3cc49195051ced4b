#include "row_plan.hpp"

#include "dashpot/islands/solref_load.hpp"

namespace dashpot {

void RowPlan::find(const mjModel_* model, const StepView& step, const Trees& trees,
                   const Options& options, double resolved, const HitFrequency& hit_frequency,
                   Rows& rows, std::vector<GroupMaterial>& materials, RowData& data, Team& team) {
  find_islands(rows, trees);
  if (read_solref_at_load(step, data.velocity, rows, materials))
    clamped_bodies_.find(model, step.contacts, rows, materials);
  deflection_limits_.find(model, step, rows, data.velocity, team);
  find_hits(step, rows, islands(), hit_frequency, data);
  inactive_contacts_.find(step, rows, islands(), static_cast<int>(trees.tree.size()), data);
  modal_damping_.find(model, materials, step.contacts, trees, inactive_contacts_.stays_open(), data,
                      step.length, rows);
  tied_mass_.find(step, materials, trees, islands(), modal_damping_.compressions(), data, rows);
  islands_.plan(rows, trees,
                {materials, deflection_limits_.of_group(), inactive_contacts_.stays_open(), data,
                 step.length, resolved, options},
                team);
}

}  // namespace dashpot
