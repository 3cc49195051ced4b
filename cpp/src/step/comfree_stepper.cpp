#include "comfree_stepper.hpp"

#include "dashpot/law/solref.hpp"
#include "dashpot/solve/comfree.hpp"

namespace dashpot {

// Nothing is remembered but the ledger, and no spring stores energy.
void Stepper::ComFreeImpl::act(mjData_* d) {
  data.reset_rows(rows);
  plan.find_islands(rows, motion.trees());
  stats.microsteps = !plan.islands().empty();
  accounting.open(memory(d), sleeping.rows());
  gap.clear();
  group_mass.clear();
  for (const RowGroup& c : rows.group) {
    if (c.kind == RowKind::kBilateral) stop_turning(rows, c);  // rates are J v alone
    const bool contact = c.kind == RowKind::kContact;
    const auto& solimp = contact ? contacts[c.input].solimp : constraints[c.input].solimp;
    gap.push_back(contact ? contacts[c.input].gap : constraints[c.input].position);
    group_mass.push_back(
        effective_mass(impedance(solimp, gap.back()), rows.typical_inverse_mass[c.row]));
  }
  const ComFree law{parameters.options.comfree_stiffness, parameters.options.comfree_damping};
  update_complementarity_free(law, rows, motion.trees(), gap, group_mass, clock.length, data);
  check_velocities();
  find_touched_trees();
  book_rows(data, {}, {}, accounting.ledger());
}

}  // namespace dashpot
