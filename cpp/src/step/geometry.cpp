// The geometry that rows have: of the middle of the step where bodies touch and turn
// (detect/turning.hpp), of the middle of the substep where an impact has cut it (impact.hpp).

#include <algorithm>
#include <cmath>

#include "dashpot/detect/turning.hpp"
#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/model/properties.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

// Micro-step (s) that rigid contacts are as stiff for.
double rigid_microstep(const Options& options, double length) {
  double count = options.microsteps;
  if (options.microsteps == 0)
    count = std::max<double>(kMinimumMicrosteps, std::ceil(length / kRigidMicrostep));
  const int of_step = static_cast<int>(std::min<double>(count, options.max_microsteps));
  return length / microsteps_of_hit(of_step, options).stiff_for;
}

}  // namespace

// Length (s) of the step that stiffness is resolved for: cuts at impacts let it be finer.
double Stepper::Impl::resolved_length() const {
  return parameters.options.impact == Impact::kCut ? clock.length : clock.whole;
}

// Of a rigid contact what micro-steps resolve of one alone; several on one body are softer.
HitFrequency Stepper::Impl::hit_frequency() const {
  const double rigid =
      std::sqrt(kStiffestAlone) / rigid_microstep(parameters.options, resolved_length());
  return [this, rigid](const ContactInput& contact, double inverse_mass) {
    const GroupMaterial given = material_of(model, parameters, contact, host::usual_gravity(model));
    if (given.from_solref) return std::min(rigid, std::sqrt(given.normalised_stiffness));
    if (given.is_rigid()) return rigid;
    return std::min(rigid, std::sqrt(given.material.stiffness * inverse_mass));
  };
}

// Contacts of bodies that turn are frozen where their forces act. The inertia of a free body goes
// there too, unless constraints hold it, which are those of the start.
void Stepper::Impl::freeze_turning_contacts(mjData_* d) {
  const HitFrequency frequency = hit_frequency();
  const Memory view = memory(d);
  host::freeze_contacts(
      model, d,
      {clock.length, differentiable, motion.trees(), data.velocity.data(), frequency, view},
      detection.faces, detection.scratch, contacts, tree_ahead, team);
  for (const ConstraintInput& constraint : constraints)
    for (int tree : constraint.tree)
      if (tree >= 0) tree_ahead[tree] = 0.0;
  for (int tree = 0; tree < motion.tree_count(); ++tree) {
    if (!motion.can_freeze_ahead(tree)) tree_ahead[tree] = 0.0;
    if (tree_ahead[tree] > 0.0) motion.freeze_ahead(tree, tree_ahead[tree]);
  }
}

void Stepper::Impl::build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart,
                                             host::MocapMotion& mocap) {
  const std::vector<ConstraintInput> start_constraints = constraints;
  mocap.show(0.5 * clock.length);
  host::MiddleGeometry middle(model, d, motion.smooth_acceleration(), detection, contacts,
                              constraints, team);
  sleeping.leave_out(model, d, contacts, constraints);
  drop_pairs(apart, contacts);
  drop_pairs(flights.near_misses(), contacts);
  mocap.drive(constraints);
  mocap.drive(contacts);
  motion.freeze_at_middle(d, clock.length, data, team);
  row_turns.forget();
  build_rows(d);
  give_back_way(rows, data, clock.length, start_constraints, contacts, constraints);
  mocap.show(0.0);
  middle.leave();
}

}  // namespace dashpot
