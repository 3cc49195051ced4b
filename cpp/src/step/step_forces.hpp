// The forces of a step: those under which MuJoCo's integrator moves trees, and, with what rows bore
// beside them, those that MuJoCo's fields and sensors report.

#pragma once

#include <vector>

#include "dashpot/threads/team.hpp"
#include "solved_substep.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class StepForces {
 public:
  // Forgets those of another substep.
  void start(const Rows& rows);
  // By row, impulses of what rows bore of changes of velocity beside the micro-steps
  // (holding_rows.hpp), to be added to.
  std::vector<double>& borne() { return borne_; }
  // Finds the mean forces of the micro-steps, and sets them in `d`.
  void find(mjData_* d, const SolvedSubstep& substep, Team& team);
  // Takes contacts beyond the model's own margin and gap out of `d` that bore nothing; `contacts`
  // get their new places there.
  void leave_out_untouched(mjData_* d, const SolvedSubstep& substep,
                           std::vector<ContactInput>& contacts);
  // Finds what is to be reported, once all is known of what rows bore.
  void find_reported(const mjData_* d, const SolvedSubstep& substep);
  // Sets the forces of MuJoCo's rows, and evaluates its sensors of accelerations.
  void report(mjData_* d, const SolvedSubstep& substep);
  // Whether generalized forces and accelerations are reported that MuJoCo does not integrate.
  bool report_others() const { return report_others_; }
  // Swaps these with those of `d`: before and after its integrator.
  void exchange(mjData_* d);

  // Generalized, of the micro-steps.
  const std::vector<double>& of_microsteps() const { return of_microsteps_; }

 private:
  bool has_borne(const RowGroup& group) const;
  void keep_borne_inside_cone(const SolvedSubstep& substep, const RowGroup& group);
  void find_mean_acceleration(int tree, const SolvedSubstep& substep);

  std::vector<double> of_microsteps_;  // generalized
  // By row and by motion coordinate; by row, forces with these.
  std::vector<double> borne_, borne_wrench_, of_row_;
  std::vector<char> contact_touched_;  // by place in d->contact
  bool report_others_ = false;
  std::vector<double> reported_, reported_acceleration_;  // generalized
};

}  // namespace dashpot
