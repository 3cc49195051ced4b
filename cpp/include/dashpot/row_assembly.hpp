// The rows of a step: what detection found, with materials, Jacobians and inverse masses.

#pragma once

#include <vector>

#include "dashpot/group_material.hpp"
#include "dashpot/memory.hpp"
#include "dashpot/mujoco_row_turns.hpp"
#include "dashpot/row_stiffness.hpp"
#include "dashpot/rows.hpp"
#include "dashpot/team.hpp"
#include "dashpot/tree_motion.hpp"

namespace dashpot {

// Replaces `rows` by those of constraints and contacts, in this order, and `materials` by theirs,
// one per group; fills in the inverse inertia of the trees they reach.
void assemble_rows(const mjModel_* model, const mjData_* data, const Parameters& parameters,
                   const std::vector<ConstraintInput>& constraints,
                   const std::vector<ContactInput>& contacts, const host::RowTurns& turns,
                   TreeMotion& motion, Rows& rows, std::vector<GroupMaterial>& materials,
                   Team& team);

// For Islands::plan, by group; the sag is a part of the smaller body's radius. Keeps its arrays
// from step to step.
class SagTimes {
 public:
  // Without gravity there is no weight. `velocity`: at the start of a step of `step` (s), in motion
  // coordinates; loads of contacts that close or open in it are not known.
  void find(const mjModel_* model, const Rows& rows, const std::vector<ContactInput>& contacts,
            const std::vector<Match>& matches, const double* velocity, double step, Team& team);

  const std::vector<SagTime>& of_group() const { return of_group_; }

 private:
  void find_dry_friction(const Rows& rows);
  // How fast (m/s^2) the dry friction of joints accelerates what a contact moves, at most:
  // |A_nd| <= sqrt(w_n w_d) of the contact's normal n and a joint d.
  double held_acceleration(const Rows& rows, const RowGroup& group) const;

  std::vector<SagTime> of_group_;
  std::vector<double> dry_friction_;  // by motion coordinate: limit times sqrt(w_d)
};

}  // namespace dashpot
