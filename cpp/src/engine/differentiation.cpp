// Steps that are to be differentiated.

#include <algorithm>

#include "dashpot/engine/engine.hpp"
#include "dashpot/mujoco/errors.hpp"
#include "dashpot/mujoco/host.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

// Goes as far into a step as the second half of the last one is known.
void Stepper::Impl::complete_last_step(mjData_* d) {
  if (parameters.options.law == Law::kComFree) return;
  const HeldMotion before = memory(d).held_motion();
  if (std::none_of(before.length, before.length + memory_layout.held_trees,
                   [](double length) { return length > 0.0; }))
    return;
  const host::ErrorGuard guard(d);
  follow_edits();
  const host::DampersInRows dampers(model, in_touch(d), detection.dampers);
  host::MocapMotion mocap(model, d, true, parameters.options.mocap_timeconst, memory(d),
                          mocap_buffers);
  detection.contact_rows = host::ContactRows::kNone;
  clock = StepClock();
  clock.whole = clock.length = host::StepParts(model, d).whole();
  start_part(d, true, host::Sensors::kStay, false, mocap);
  detect(d, mocap);
  find_rows(d, mocap);
  if (const double* added = trapezoid.added_velocity())
    for (int index = 0; index < motion.tree_count(); ++index)
      if (trapezoid.holds(index)) motion.add_velocity(d, index, added);
}

void Stepper::differentiate(bool whether) { impl_->differentiable = whether; }

void Stepper::complete_last_step(mjData_* data) { impl_->complete_last_step(data); }

}  // namespace dashpot
