// Where to cut a step at an impact.
//
// Rows are frozen over a step: gaps close along the normals found at its start. Of a pair whose
// relative motion in the step is not small against its thinner geom such rows are no use: the
// contact begins elsewhere, with another normal, or never. Let
//
//     s = a bound on the speed at which any two points of the pair approach, with that which its
//         compressed contacts can still give it in a step, x sqrt(k w) min(1, sqrt(k w) H),
//     e = half the least width of its thinner geom.
//
// A pair is fast where s H > e / 4. Of the fast pairs,
//
// - those apart get their time of impact, up to a standoff that covers what the motion over the
//   step departs from constant velocity by, |a| H^2 / 8. The part of the step ends there. Within
//   it their rows are left out: the pair is proven apart. (Rows stay where an impact elsewhere in
//   this part could change the motion, and for articulated trees, whose motion is not rigid.)
// - those in touch keep their rows, with normals found at the surface, for a part in which neither
//   geom turns by more than 0.02 rad nor the pair approaches by more than e / 4.
//
// The rest of the step follows in the same way with fresh collision. Parts are cut at most kMaxCuts
// times in a step; the last takes all that remains.

#pragma once

#include <vector>

#include "dashpot/memory.hpp"
#include "dashpot/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

inline constexpr int kMaxCuts = 128;

// Length (s) of the next part of a step, at most `remaining`, which is returned where nothing is
// fast. Contacts of pairs that stay apart during the part are taken out of `contacts`.
// `acceleration` (nv) is the mean smooth acceleration, `cuts_left` >= 1.
double part_before_impact(const mjModel_* model, const mjData_* data, const Memory& memory,
                          const std::vector<double>& acceleration,
                          const std::vector<ConstraintInput>& constraints, double whole,
                          double remaining, int cuts_left, std::vector<ContactInput>& contacts);

}  // namespace dashpot
