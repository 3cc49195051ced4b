// A step by the complementarity-free law (solve/comfree.hpp), and all that sets it apart.
//
// Contact does not start within a step, which is never shortened for what turns or is thrown about.
// Rows have the geometry of its start, remember nothing, and act in a single update. MuJoCo moves
// all trees, so no Verlet corrector is left to the next step.

#pragma once

#include <vector>

#include "dashpot/law/solref.hpp"
#include "dashpot/solve/comfree.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

struct Stepper::ComFreeImpl final : Stepper::Impl {
  ComFreeImpl(mjModel_* m, const Parameters& p, int threads) : Impl(m, p, threads, false) {}

  void complete_last_step(mjData_*) override {}
  void solve_substep(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap) override {
    detect_and_solve(d, substeps, mocap);
  }
  void correct_contacts_ahead(mjData_*) override {}
  void freeze_within_step(mjData_*) override {}
  void finish_last_step(mjData_*) override {}
  // Nothing is remembered but the ledger, and no spring stores energy.
  void act(mjData_* d) override {
    data.reset_rows(rows);
    for (const RowGroup& c : rows.group)
      for (int tree : c.tree)
        if (tree >= 0 && motion.trees().tree[tree].sparse) motion.invert_inertia(d, tree);
    islands.find(rows, motion.trees());
    stats.microsteps = !islands.all().empty();
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
  void report_forces(mjData_* d) override { forces.report(d, solved_substep()); }
  void advance_state(mjData_* d) override { integrate_by_mujoco(d); }

  std::vector<double> gap, group_mass;  // by group: m or rad; kg or kg m^2
};

}  // namespace dashpot
