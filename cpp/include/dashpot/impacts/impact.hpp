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
//   that of the middle of the substep (see middle.hpp), so that errors are quadratic in the turn.
//
// The rest of the step follows in the same way with fresh collision. Substeps are cut at most
// kMaxCuts times in a step; the last takes all that remains.

#pragma once

#include <vector>

#include "dashpot/impacts/geom_pair.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_clock.hpp"

struct mjModel_;
struct mjData_;

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

}  // namespace dashpot
