#include "dashpot/islands/hit_frequency.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/mujoco/properties.hpp"

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

double hit_frequency(const mjModel_* model, const Parameters& parameters,
                     const ContactInput& contact, double inverse_mass, double length) {
  const double rigid = std::sqrt(kStiffestAlone) / rigid_microstep(parameters.options, length);
  const GroupMaterial given = material_of(model, parameters, contact, host::usual_gravity(model));
  if (given.from_solref) return std::min(rigid, std::sqrt(given.normalised_stiffness));
  if (given.is_rigid()) return rigid;
  return std::min(rigid, std::sqrt(given.material.stiffness * inverse_mass));
}

}  // namespace dashpot
