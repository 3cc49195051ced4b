#include "row_plan.hpp"

#include "dashpot/islands/island_hits.hpp"
#include "dashpot/islands/modal_damping.hpp"
#include "dashpot/islands/solref_load.hpp"
#include "dashpot/islands/static_deflection_limits.hpp"

namespace dashpot {

void RowPlan::find(const mjModel_* model, const StepView& step, const Trees& trees,
                   const Options& options, double resolved, const HitFrequency& hit_frequency,
                   Rows& rows, std::vector<GroupMaterial>& materials, RowData& data, Team& team) {
  find_islands(rows, trees);
  if (read_solref_at_load(step, data.velocity, rows, materials))
    damp_clamped_bodies(model, step.contacts, rows, materials);
  find_deflection_times(model, step, rows, data.velocity, team, deflection_times_);
  find_hits(step, rows, islands(), hit_frequency, data);
  find_inactive_contacts(step, rows, islands(), static_cast<int>(trees.tree.size()), data,
                         stays_open_);
  damp_modes(model, materials, step.contacts, trees, stays_open_, data, step.length, rows,
             compression_);
  tied_mass_.find(step, materials, trees, islands(), compression_, data, rows);
  islands_.plan(rows, trees,
                {materials, deflection_times_, stays_open_, data, step.length, resolved, options},
                team);
}

}  // namespace dashpot
