#include "dashpot/rows/energy_ledger.hpp"

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

}  // namespace dashpot
