// How fast what is hit swings on its contact, of which hit.hpp knows when its force acts.

#pragma once

#include "dashpot/law/parameters.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;

namespace dashpot {

// sqrt(k w) (rad/s) that a contact of the apparent inverse mass w (1/kg) will have where stiffness
// is resolved for a step of `length` (s): of a rigid one what micro-steps resolve of a contact
// alone; several on one body are softer.
double hit_frequency(const mjModel_* model, const Parameters& parameters,
                     const ContactInput& contact, double inverse_mass, double length);

}  // namespace dashpot
