// The energy ledger: kinetic + potential + elastic + dissipated - work is constant.

#pragma once

#include <vector>

#include "dashpot/rows/row_data.hpp"

namespace dashpot {

// Energies since the data was made or reset, J. `elastic` is the present store.
struct EnergyLedger {
  double elastic = 0.0;
  double dissipated_normal = 0.0;  // and what frozen inertia takes (or, negative, gives) in hits
  double dissipated_friction = 0.0;
  double dissipated_constraint = 0.0;
  double dissipated_recovery = 0.0;  // negative when recovery has put energy in
  double dissipated_damping = 0.0;   // by dampers of joints and tendons, and by fluids
  // Of actuators, applied forces, gravity compensation, mocap bodies and moving surfaces.
  double work = 0.0;

  // What contacts have dissipated, J, with what recovery took or put in.
  double dissipated_by_contacts() const {
    return dissipated_normal + dissipated_friction + dissipated_recovery;
  }
};

// Books what the rows did in a step: `before` and `after` are the elastic energies that memory
// brought back and that the micro-steps left. Elastic energy that memory did not bring back, and
// work of the recovering surface, count as recovery; what the rows took from the bodies and did not
// store was dissipated.
void book_rows(const RowData& data, const EnergyShares& before, const EnergyShares& after,
               EnergyLedger& ledger);

}  // namespace dashpot
