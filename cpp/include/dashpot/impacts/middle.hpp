// Geometry of the middle of a substep.
//
// Rows freeze the geometry. Frozen at the start of a substep in which bodies turn by some angle,
// lever arms and normals are wrong by that angle; frozen where smooth motion brings the bodies in
// the middle of the substep, the errors before and after the middle cancel, and what remains is
// quadratic in the angle. Gaps are those at the start all the same: what the smooth motion closes
// up to the middle is given back.

#pragma once

#include <vector>

#include "dashpot/impacts/geom_pair.hpp"
#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"

namespace dashpot {

// Replaces the gaps of contacts and the positions of constraints, whose `rows` were found in the
// middle of a substep of `length` (s), by those at its start, where `start_constraints` were found:
// what the smooth motion in `data` closes up to the middle is given back.
void give_back_way(const Rows& rows, const RowData& data, double length,
                   const std::vector<ConstraintInput>& start_constraints,
                   std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints);

// A rigid contact of the sorted pairs under `impact` becomes a spring whose contact time is about a
// substep of `length` (s), so that the substep resolves it; one that is compressed keeps its
// spring. What rigid means is thus the limit of ever stiffer springs with the same damping ratio.
void give_rigid_impacts_springs(const Memory& memory, const std::vector<GeomPair>& impact,
                                const std::vector<ContactInput>& contacts, const Rows& rows,
                                double length, std::vector<GroupMaterial>& materials);

}  // namespace dashpot
