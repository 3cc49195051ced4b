// The complementarity-free law in a step, see comfree.hpp.

#include "dashpot/microsteps/comfree.hpp"

#include "dashpot/law/solref.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

// Nothing is remembered but the ledger, and no spring stores energy.
void Stepper::Impl::update_complementarity_free(mjData_* d) {
  data.reset_rows(rows);
  plan.find_islands(rows, motion.trees());
  books.open(memory(d), sleeping.rows());
  comfree_groups.gap.clear();
  comfree_groups.effective_mass.clear();
  for (const RowGroup& c : rows.group) {
    const bool contact = c.kind == RowKind::kContact;
    comfree_groups.gap.push_back(contact ? contacts[c.input].gap : constraints[c.input].position);
    comfree_groups.effective_mass.push_back(
        effective_mass(impedance(contact ? contacts[c.input].solimp : constraints[c.input].solimp,
                                 comfree_groups.gap.back()),
                       rows.typical_inverse_mass[c.row]));
  }
  const ComFree law{parameters.options.comfree_stiffness, parameters.options.comfree_damping};
  dashpot::update_complementarity_free(law, rows, motion.trees(), comfree_groups.gap,
                                       comfree_groups.effective_mass, clock.length, data);
  check_velocities();
  find_touched_trees();
  book_rows(data, {}, {}, books.ledger());
}

}  // namespace dashpot
