// Geometry of the middle of a part of a step.
//
// Rows freeze the geometry. Frozen at the start of a part in which bodies turn by some angle, lever
// arms and normals are wrong by that angle; frozen where smooth motion brings the bodies in the
// middle of the part, the errors before and after the middle cancel, and what remains is quadratic
// in the angle. Gaps are those at the start all the same: what the smooth motion closes up to the
// middle is given back, or, better, the gap of the same point at the start is taken.

#pragma once

#include <vector>

#include "dashpot/rows.hpp"

namespace dashpot {

// Replaces the gaps of contacts found in the middle of a part by those at its start. A contact
// takes the gap of its nearest contact of the same pair at the start where each is the other's
// nearest and the point has moved on one of the two geoms by no more than twice the way (m, one for
// each contact) that the two geoms have moved along each other there; otherwise it keeps its gap.
void take_gaps_at_start(const std::vector<ContactInput>& start, const std::vector<double>& way,
                        std::vector<ContactInput>& contacts);

}  // namespace dashpot
