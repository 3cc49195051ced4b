#include "dashpot/rows/energy_ledger.hpp"

#include <algorithm>

namespace dashpot {

void book_rows(const RowData& data, const EnergyShares& before, const EnergyShares& after,
               EnergyLedger& ledger) {
  ledger.dissipated_recovery += ledger.elastic - before.sum() - data.recovery_input.sum();
  ledger.dissipated_normal +=
      data.recovery_input.normal - data.work.normal - (after.normal - before.normal);
  ledger.dissipated_friction -= data.work.friction + (after.friction - before.friction);
  ledger.dissipated_constraint += data.recovery_input.constraint - data.work.constraint -
                                  (after.constraint - before.constraint);
  ledger.dissipated_damping -= data.work.damping;
  ledger.elastic = after.sum();
}

void book_left_to_rows(const Rows& rows, const RowData& data, const std::vector<int>& group,
                       const std::vector<double>& left, EnergyLedger& ledger) {
  if (std::all_of(left.begin(), left.end(), [](double energy) { return energy == 0.0; })) return;
  thread_local std::vector<EnergyShares> given;  // kept by the thread: no allocation in a step
  given.assign(left.size(), {});
  for (const RowGroup& c : rows.group) {
    const int first = c.tree[0] < 0 ? -1 : group[c.tree[0]];
    const int second = c.tree[1] < 0 ? -1 : group[c.tree[1]];
    for (int index : {first, second == first ? -1 : second}) {
      if (index < 0) continue;
      for (int i = 0; i < c.dim; ++i) {
        const double impulse = data.total_impulse[c.row + i];
        share(given[index], c, i) += 0.5 * impulse * impulse * rows.inverse_mass[c.row + i];
      }
    }
  }
  for (size_t index = 0; index < left.size(); ++index) {
    const double sum = given[index].sum();
    if (sum == 0.0) {
      ledger.dissipated_damping += left[index];
      continue;
    }
    const double part = left[index] / sum;
    ledger.dissipated_normal += part * given[index].normal;
    ledger.dissipated_friction += part * given[index].friction;
    ledger.dissipated_constraint += part * given[index].constraint;
    ledger.dissipated_damping += part * given[index].damping;
  }
}

}  // namespace dashpot
