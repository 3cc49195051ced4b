// The spring that a rigid contact is while an impact lasts.

#pragma once

#include "dashpot/law/material.hpp"

namespace dashpot {

// Turns a rigid material into the spring of an impact, seen by a contact of apparent inverse mass w
// (1/kg) in a part of `length` (s): undamped contact would last pi sqrt(m / k) = 0.9 of the part. A
// contact that is compressed with `stiffness` (N/m, 0 for none) keeps it as far as micro-steps of
// the part resolve it. Nothing changes where w is zero.
void make_impact_spring(Material& material, double inverse_mass, double length, double stiffness);

}  // namespace dashpot
