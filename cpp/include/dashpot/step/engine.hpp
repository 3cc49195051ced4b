// The stepping engine: statistics and the stepper.
//
// Parameters are fixed during a step, mjData changes, StepStats is the result. A Stepper is used
// by one thread at a time and has the model to itself while it steps: during the step it widens
// contact detection in the model and, where it cuts the step into substeps, changes opt.timestep;
// both are restored. What MuJoCo derives from masses follows edits of these
// (model/body_inertia.hpp). Parallel work on many states gives every worker its own view of the
// model (model/state.hpp) and its own Stepper; a Stepper of several threads shares the passes of a
// single step among them.

#pragma once

#include <functional>
#include <memory>

#include "dashpot/law/parameters.hpp"
#include "dashpot/model/mujoco_types.hpp"

namespace dashpot {

// Statistics of the last of the steps taken (the maximum or the sum over all of them where said);
// of a step in substeps, those of its last substep.
struct StepStats {
  int contacts = 0;              // contacts that could touch during the step
  int touching = 0;              // contacts that carried an impulse
  int islands = 0;               // islands of trees joined by rows
  int microsteps = 0;            // largest number of micro-steps of an island (maximum over steps)
  int clipped = 0;               // rows whose stiffness or damping was lowered (maximum over steps)
  double max_penetration = 0.0;  // m, deepest overlap less margin at a step's start (maximum)
  double max_compression = 0.0;  // m, deepest compression at a step's end (maximum)
  int cuts = 0;                  // cuts at impacts (sum over steps)
  int parts = 0;                 // that a step was taken in (maximum over steps)
};

// Values of the model may be edited between steps, but not vertices of meshes: hulls are kept.
class Stepper {
 public:
  // `model` must outlive the stepper. Throws std::invalid_argument naming the feature that is
  // refused, or the size of `parameters` that does not fit the model. `threads` >= 1 share the
  // passes of a step (team.hpp), the calling one among them; results are the same bit for bit.
  Stepper(mjModel_* model, const Parameters& parameters, int threads = 1);
  ~Stepper();
  Stepper(Stepper&&) noexcept;
  Stepper& operator=(Stepper&&) noexcept;

  // Advances `data` by nstep * timestep. Throws std::invalid_argument, before anything is changed,
  // on a state that is not finite or data of another model; DivergenceError where motion or forces
  // diverge, which leaves `data` as they were before that step. MuJoCo's force queries
  // and sensors read its rows of contacts (efc_*). The last step leaves them in `data` where they
  // fit into the memory of the model; where `leave_rows` is false none are left. Sensors, plugins
  // and flexes need them in every step: std::runtime_error where they do not fit. `between` is
  // called after every step but the last; what it throws ends the call there.
  StepStats step(mjData_* data, int nstep = 1, bool leave_rows = true,
                 const std::function<void()>& between = {});

  // Whether steps are to be differentiated: then contacts move to the middle of the step by motion
  // of any size, where what is less than 10 urad counts as rest otherwise, and the Verlet corrector
  // of a step is taken as it is, which energies scale otherwise.
  void differentiate(bool whether);
  // Adds to the velocities of `data`, which step() has left, the Verlet corrector of that step,
  // which the next one would start with (integrate/trapezoid.hpp). That one then starts from there.
  void complete_last_step(mjData_* data);

 private:
  struct Impl;
  struct ComFreeImpl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dashpot
