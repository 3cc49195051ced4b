// Which MJCF features the engine honours, maps or refuses. Part of the mujoco_host room.

#pragma once

#include <string>
#include <vector>

#include "dashpot/law.hpp"

struct mjModel_;

namespace dashpot::host {

// How the engine treats one feature that a model uses, under a law.
enum class Treatment { kHonoured, kMapped, kRefused };
struct Feature {
  std::string name;
  Treatment treatment = Treatment::kHonoured;
  std::string note;
};
std::vector<Feature> features(const mjModel_* m, Law law);

// Throws std::invalid_argument naming every refused feature, a geom, pair or flex whose friction is
// negative or not finite, a body whose mass or a geom whose size is, or a height of a field that is
// not finite.
void check_supported(const mjModel_* m, Law law);
// The same for options, friction, masses and sizes alone, which may be edited between steps. Also
// requires the elliptic cone, whose row layout force reports rely on, and a positive time step.
void check_options(const mjModel_* m, Law law);

}  // namespace dashpot::host
