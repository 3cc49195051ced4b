#include "dashpot/energy_ledger.hpp"

namespace dashpot {

void book_rows(const RowData& data, const EnergyShares& before, const EnergyShares& after,
               EnergyLedger& ledger) {
  ledger.dissipated_recovery += ledger.elastic - before.sum() - data.recovery_input.sum();
  ledger.dissipated_normal +=
      data.recovery_input.normal - data.work.normal - (after.normal - before.normal);
  ledger.dissipated_friction -= data.work.friction + (after.friction - before.friction);
  ledger.dissipated_constraint += data.recovery_input.constraint - data.work.constraint -
                                  (after.constraint - before.constraint);
  ledger.elastic = after.sum();
}

void book_left_to_rows(const Rows& rows, const RowData& data, const std::vector<int>& group,
                       const std::vector<double>& left, EnergyLedger& ledger) {
  for (size_t index = 0; index < left.size(); ++index) {
    if (left[index] == 0.0) continue;
    const auto is_on = [&](int tree) {
      return tree >= 0 && group[tree] == static_cast<int>(index);
    };
    EnergyShares given;
    for (const RowGroup& c : rows.group) {
      if (!is_on(c.tree[0]) && !is_on(c.tree[1])) continue;
      for (int i = 0; i < c.dim; ++i) {
        const double impulse = data.total_impulse[c.row + i];
        share(given, c, i) += 0.5 * impulse * impulse * rows.inverse_mass[c.row + i];
      }
    }
    if (given.sum() == 0.0) {
      ledger.dissipated_damping += left[index];
      continue;
    }
    const double part = left[index] / given.sum();
    ledger.dissipated_normal += part * given.normal;
    ledger.dissipated_friction += part * given.friction;
    ledger.dissipated_constraint += part * given.constraint;
  }
}

}  // namespace dashpot
