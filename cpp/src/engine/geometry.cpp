// The geometry that rows have: of the middle of the step where bodies touch and turn
// (detection/turning.hpp), of a part of it where an impact begins within (impact.hpp) or trees turn
// far (turning_parts.hpp).

#include <algorithm>

#include "dashpot/detection/turning.hpp"
#include "dashpot/islands/hit_frequency.hpp"
#include "dashpot/motion/turning_parts.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

// Ends this part of the step where trees have turned as far as MuJoCo's integrators follow, or
// equalities, at their rate in the part before, as far as their rows do; returns whether that is
// earlier.
bool Stepper::Impl::shorten_for_turns(mjData_* d, host::StepParts& parts) {
  if (parameters.options.law == Law::kComFree) return false;
  const double* const held = memory(d).held_motion().held;
  return shorten(std::min(part_of_smooth_turn(model, d, motion, held, clock),
                          part_of_turning_rows(clock.row_turn_rate * clock.length, clock)),
                 parts);
}

// Ends the part earlier where its rows have thrown trees about; returns whether they have.
bool Stepper::Impl::shorten_for_throws(host::StepParts& parts) {
  if (parameters.options.law == Law::kComFree) return false;
  return shorten(part_of_thrown_turn(model, motion, data, on_trees.touched, clock), parts);
}

// Ends the part earlier where equalities turn far in it; returns whether they do. Their rate of
// turn is kept for the next part, in which they most often go on so.
bool Stepper::Impl::shorten_for_rows(host::StepParts& parts) {
  if (parameters.options.law == Law::kComFree) return false;
  const double turn = trapezoid.fastest_turn();
  clock.row_turn_rate = turn / clock.length;
  return shorten(part_of_turning_rows(turn, clock), parts);
}

bool Stepper::Impl::shorten(double shorter, host::StepParts& parts) {
  if (shorter == clock.length) return false;
  clock.length = shorter;
  parts.set_length(clock.length);
  detection.narrowphase.forget();  // for collisions look as far ahead as the part is long
  return true;
}

// Ends this part of the step where the next impact begins.
void Stepper::Impl::cut_at_impact(mjData_* d, host::StepParts& parts) {
  part = part_before_impact(model, d, memory(d), motion.smooth_acceleration(), constraints,
                            contacts, clock);
  drop_pairs(part.apart, contacts);
  clock.cut_short = shorten(part.length, parts);
}

// Length (s) of the step that stiffness is resolved for: cuts at impacts let it be finer.
double Stepper::Impl::resolved_length() const {
  return parameters.options.impact == Impact::kCut ? clock.length : clock.whole;
}

HitFrequency Stepper::Impl::hit_frequency() const {
  return [this](const ContactInput& contact, double inverse_mass) {
    return dashpot::hit_frequency(model, parameters, contact, inverse_mass, resolved_length());
  };
}

// Contacts of bodies that turn are frozen where their forces act. The inertia of a free body goes
// there too, unless constraints hold it, which are those of the start.
void Stepper::Impl::freeze_turning_contacts(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  const HitFrequency frequency = hit_frequency();
  const Memory view = memory(d);
  host::freeze_contacts(model, d,
                        {clock.length, differentiable, motion.trees(), data.velocity.data(),
                         frequency, view},
                        detection.faces, detection.workplaces, contacts, tree_ahead, team);
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
  const std::vector<ContactInput> start = contacts;
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
  give_back_way(rows, data, clock.length, start, start_constraints, contacts, constraints);
  mocap.show(0.0);
  middle.leave();
}

}  // namespace dashpot
