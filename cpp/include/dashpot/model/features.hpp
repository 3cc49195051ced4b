// Which MJCF features the engine honours, maps or refuses.

#pragma once

#include <string>
#include <vector>

#include "dashpot/law/parameters.hpp"
#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

// How the engine treats one feature that a model uses, under a law.
enum class Treatment { kHonoured, kMapped, kRefused };
struct Feature {
  std::string name;
  Treatment treatment = Treatment::kHonoured;
  std::string note;
};
std::vector<Feature> features(const mjModel_* m, Law law);

// Throws std::invalid_argument naming every refused feature, or what check_values() and
// check_heights() name (model/checks.hpp).
void check_supported(const mjModel_* m, Law law);
// The same, and that what the options ask of impacts is defined for the law and the model.
void check_supported(const mjModel_* m, const Options& options);
// The same for options and values alone, which may be edited between steps. Also requires the
// elliptic cone, whose row layout force reports rely on.
void check_options(const mjModel_* m, Law law);

}  // namespace dashpot::host
