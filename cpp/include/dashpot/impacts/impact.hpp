// Where to cut a step at an impact.
//
// Rows are frozen over a step: gaps close along the normals found at its start. Of a pair whose
// relative motion in the step is not small against its thinner geom (fast_pairs.hpp) such rows are
// no use: the contact begins elsewhere, with another normal, or never. Of the fast pairs,
//
// - those apart get their time of impact, up to a standoff that covers what the motion over the
//   step departs from constant velocity by, |a| H^2 / 8. The substep ends there. Within
//   it their rows are left out: the pair is proven apart. (Rows stay where an impact elsewhere in
//   this substep could change the motion, and for articulated trees, whose motion is not rigid.)
// - those in touch keep their rows while neither geom turns by more than 0.005 rad,
//   nor the normal of two round ones, nor the pair approaches by more than e / 4. The geometry is
//   that of the middle of the substep.
//
// The rest of the step follows in the same way with fresh collision. Substeps are cut at most
// kMaxCuts times in a step; the last takes all that remains.
//
// Rows freeze the geometry. Frozen at the start of a substep in which bodies turn by some angle,
// lever arms and normals are wrong by that angle; frozen where smooth motion brings the bodies in
// the middle of the substep, the errors before and after the middle cancel, and what remains is
// quadratic in the angle. Gaps are those at the start all the same: what the smooth motion closes
// up to the middle is given back.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

inline constexpr int kMaxCuts = 96;

// The next substep.
struct Substep {
  double length = 0.0;  // s
  // Fast pairs in touch, and pairs proven apart during the substep, whose contacts are to be left
  // out. Both are sorted.
  std::vector<GeomPair> impact, apart;
};

// The next substep, at most as long as the present one is, which is its length where nothing
// is fast. `acceleration` (nv) is the mean smooth acceleration over that. Without cuts left the
// substep is what it is, and no pair is proven apart.
Substep substep_before_impact(const mjModel_* model, const mjData_* data, const Memory& memory,
                              const std::vector<double>& acceleration,
                              const std::vector<ConstraintInput>& constraints,
                              const std::vector<ContactInput>& contacts, const StepClock& clock);

// Takes out the contacts of some sorted pairs.
void drop_pairs(const std::vector<GeomPair>& pairs, std::vector<ContactInput>& contacts);

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
