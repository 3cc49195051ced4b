// The stepping engine: options, parameters, statistics and the stepper.
//
// Parameters are fixed during a step, mjData changes, StepStats is the result. A Stepper is used
// by one thread at a time and has the model to itself while it steps (it widens contact detection
// in the model during the step and restores it). Parallel work gives every worker its own copy of
// the model and its own Stepper.

#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "dashpot/law.hpp"
#include "dashpot/material.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

// What a step does where geoms could pass through or deep into each other: nothing, or end a part
// of the step at the impact (impact.hpp).
enum class Impact { kNone, kCut };

struct Options {
  Law law = Law::kKelvinVoigt;
  int microsteps = 0;           // fixed number per step, >= 1; 0: chosen per island ("auto")
  int max_microsteps = 64;      // >= 1; stiffness beyond what they resolve is lowered
  double recovery_speed = 0.1;  // m/s, >= 0, may be infinite: how fast unstressed overlap recovers
  Impact impact = Impact::kNone;
  CombinationRules rules;
  // Of Law::kComFree alone, as the options above are of Law::kKelvinVoigt; see comfree.hpp.
  double comfree_stiffness = 0.2;  // 1/s, > 0
  double comfree_damping = 0.001;  // >= 0
};

// Everything that calibration may vary, besides the model itself.
struct Parameters {
  Options options;
  std::vector<Material> geom_material;                    // one per geom
  std::map<std::pair<int, int>, Material> pair_material;  // geom ids, smaller first
};

// Statistics of the last of the steps taken (maxima over all of them where said); of a step in
// parts, those of its last part.
struct StepStats {
  int contacts = 0;              // contacts that could touch during the step
  int touching = 0;              // contacts that carried an impulse
  int islands = 0;               // islands of trees joined by contacts
  int microsteps = 0;            // largest number of micro-steps of an island (maximum over steps)
  int clipped = 0;               // rows whose stiffness or damping was lowered (maximum over steps)
  double max_penetration = 0.0;  // m, deepest geometric overlap at a step's start (maximum)
  double max_compression = 0.0;  // m, deepest spring compression at a step's end (maximum)
  int cuts = 0;                  // cuts at impacts (sum over steps)
};

class Stepper {
 public:
  // `model` must outlive the stepper. Throws std::invalid_argument naming the feature that is
  // refused, or the size of `parameters` that does not fit the model.
  Stepper(mjModel_* model, const Parameters& parameters);
  ~Stepper();
  Stepper(Stepper&&) noexcept;
  Stepper& operator=(Stepper&&) noexcept;

  // Advances `data` by nstep * timestep. Throws std::invalid_argument, before anything is changed,
  // on a state that is not finite or data of another model.
  // MuJoCo's constraint rows of contacts (efc_*), which its force queries and sensors read, are
  // left in `data` for the last step, and where `leave_rows` is false only if sensors, plugins,
  // callbacks or flexes need them.
  StepStats step(mjData_* data, int nstep = 1, bool leave_rows = true);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dashpot
