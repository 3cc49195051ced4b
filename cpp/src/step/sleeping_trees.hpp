// Trees that sleep (model/sleep.hpp): what wakes them in a step, and which fall asleep at its end.

#pragma once

#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/model/mocap_motion.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "solved_substep.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class SleepingTrees {
 public:
  // As mjData.tree_asleep at the start of the step; empty if nothing sleeps.
  std::vector<int>& at_start() { return at_start_; }

  // Wakes what rows join to awake trees or to mocap bodies that move; returns whether any.
  bool wake_reached(const mjModel_* m, mjData_* d, const std::vector<ContactInput>& contacts,
                    const std::vector<ConstraintInput>& constraints,
                    const host::MocapMotion& mocap) const;
  // Takes out the rows of what sleeps, on mocap bodies that stay where they are, too.
  void leave_out(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints);
  // The rows that it would have.
  const MarkedRows& rows() const { return rows_; }

  // Counts the step, and finds the trees whose islands have come to rest in it. `recovered`, by
  // degree of freedom: how far recovery took positions beside their velocity.
  const std::vector<int>& find_falling(mjData_* d, const SolvedSubstep& substep,
                                       const std::vector<Island>& islands,
                                       const host::MocapMotion& mocap,
                                       const std::vector<double>& recovered);
  // Puts these to sleep, at rest where they are.
  void put_to_sleep(mjModel_* m, mjData_* d) const;

 private:
  void find_driven(const SolvedSubstep& substep, const host::MocapMotion& mocap);

  std::vector<int> at_start_, falling_;
  MarkedRows rows_;
  std::vector<int> island_of_;          // by tree, -1 for none
  std::vector<char> driven_;            // by tree: by mocap bodies that move
  std::vector<double> recovery_speed_;  // by degree of freedom
};

}  // namespace dashpot
