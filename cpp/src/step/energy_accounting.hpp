// What becomes of the energy of a step (rows/row_data.hpp).

#pragma once

#include <vector>

#include "dashpot/model/forces.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/threads/team.hpp"
#include "solved_substep.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class EnergyAccounting {
 public:
  // Begins with the ledger that memory has, but for the energy of what sleeps.
  void open(const Memory& memory, const MarkedRows& sleeping);
  void close(Memory& memory);
  EnergyLedger& ledger() { return ledger_; }

  // By tree, work (J) of contacts, because they turn, that no spring paid for: no more than all
  // contacts together did too much. Shared by two trees as their relative motion is.
  void find_unpaid(const Memory& memory, const SolvedSubstep& substep,
                   std::vector<double>& unpaid) const;
  // Once the state is that of the substep's end: books the work of smooth forces and surfaces.
  void add_smooth_work(mjData_* d, const SolvedSubstep& substep, Team& team);
  // Books the kinetic energy of trees that fall asleep, and keeps the ledger in memory.
  void lose_motion(const mjData_* d, const SolvedSubstep& substep, const std::vector<int>& trees,
                   Memory& memory);

  // By degree of freedom: what the change of kinetic energy goes with, and how far recovery of
  // equalities took trees beside it.
  const std::vector<double>& displacement() const { return displacement_; }
  const std::vector<double>& recovered() const { return recovered_; }

 private:
  void find_displacements(const mjData_* d, const SolvedSubstep& substep, Team& team);
  double work_ahead_of_servos(const SolvedSubstep& substep) const;

  EnergyLedger ledger_;
  double elastic_asleep_ = 0.0;  // J
  host::SmoothWork smooth_work_;
  std::vector<char> in_microsteps_;               // by tree: it went as in these
  std::vector<double> displacement_, recovered_;  // by degree of freedom
};

}  // namespace dashpot
