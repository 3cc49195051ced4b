// Options and materials of the engine: everything about a step that is not in the MuJoCo model.

#pragma once

#include <map>
#include <utility>
#include <vector>

#include "dashpot/law/material.hpp"

namespace dashpot {

enum class Law {
  kKelvinVoigt,  // kelvin_voigt.hpp and friction.hpp, in micro-steps
  kComFree       // comfree.hpp, one update per step
};

// What a step does where geoms could pass through or deep into each other: nothing, or end a part
// of the step at the impact (impact.hpp).
enum class Impact { kNone, kCut };

struct Options {
  Law law = Law::kKelvinVoigt;
  int microsteps = 0;           // fixed number per step, >= 1; 0: chosen per island ("auto")
  int max_microsteps = 64;      // >= 1; stiffness beyond what they resolve is lowered
  double recovery_speed = 0.1;  // m/s, >= 0, may be infinite: how fast unstressed overlap recovers
  double mocap_timeconst = 0.02;  // s, >= 0: of bodies that users move, mocap_motion.hpp
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
  int contact_capacity = 0;  // contacts that data of the model remember, see memory_layout()
};

}  // namespace dashpot
