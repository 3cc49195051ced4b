// In which times loads move contacts by the sag that a rigid one may have.
//
// Islands::plan makes micro-steps so short that rigid contacts are stiff enough for what they bear:
// a weight, what drives a joint against its dry friction, and the load of the last step.

#pragma once

#include <vector>

#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"
#include "dashpot/threads/team.hpp"

struct mjModel_;

namespace dashpot {

// Keeps its arrays from step to step.
class StaticDeflectionLimits {
 public:
  // Finds the times of every group; the sag is kRigidSag times the smaller body's radius, less
  // if it is thin (host::bearing_radius). Without gravity there is no weight. `velocity`: at the
  // start of the step, in motion coordinates; loads of contacts that close or open in it are not
  // known.
  void find(const mjModel_* model, const StepView& step, const Rows& rows,
            const AlignedDoubles& velocity, Team& team);

  const std::vector<DeflectionTime>& of_group() const { return of_group_; }

 private:
  void find_dry_friction(const Rows& rows, size_t constraints);
  void find_heavier(const Rows& rows);
  // Of a contact with what does not move: what is heavier on the tree presses it down, too.
  double heavier_on(const RowGroup& group) const;
  // How fast (m/s^2) the dry friction of joints accelerates what a contact moves, at most:
  // |A_nd| <= sqrt(w_n w_d) of the contact's normal n and a joint d.
  double held_acceleration(const Rows& rows, const RowGroup& group) const;

  std::vector<DeflectionTime> of_group_;
  std::vector<double> dry_friction_;  // by motion coordinate: limit times sqrt(w_d)
  std::vector<double> heavier_;       // by tree: of what it touches, the largest mass over its own
};

}  // namespace dashpot
