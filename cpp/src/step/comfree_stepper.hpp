// A step by the complementarity-free law (solve/comfree.hpp), and all that sets it apart.
//
// Contact does not start within a step, which is never shortened for what turns or is thrown about.
// Rows have the geometry of its start, remember nothing, and act in a single update. MuJoCo moves
// all trees, so no Verlet corrector is left to the next step.

#pragma once

#include <vector>

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
  void act(mjData_* d) override;
  void report_forces(mjData_* d) override { forces.report(d, solved_substep()); }
  void advance_state(mjData_* d) override { integrate_by_mujoco(d); }

  std::vector<double> gap, group_mass;  // by group: m or rad; kg or kg m^2
};

}  // namespace dashpot
