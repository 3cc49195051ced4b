// Which pairs of geoms MuJoCo lets collide, in which order, and how far apart.

#pragma once

#include <array>

struct mjModel_;

namespace dashpot::host {

// Two geoms in the order in which MuJoCo's collisions take their types.
struct CandidatePair {
  std::array<int, 2> geom;
  int defined = -1;     // index of the <pair> that defines it, -1 for none
  unsigned bodies = 0;  // by which MuJoCo orders pairs
  double within = 0.0;  // m, how far apart its contacts are looked for
};

// Two geoms in that order, `defined` by a <pair>, or -1.
CandidatePair pair_of(const mjModel_* m, int geom1, int geom2, int defined);

// MuJoCo's order: by bodies; of two bodies, what <pair>s define first.
bool comes_before(const CandidatePair& a, const CandidatePair& b);

// Whether MuJoCo lets two geoms collide that no <pair> names: by their bits, by bodies that are
// welded or next to each other, and by exclusions. Filters that callbacks add are not asked.
bool may_meet(const mjModel_* m, int geom1, int geom2);

// Distance (m) at which contact of a pair starts, and how far beyond it contacts are detected.
double margin_of(const mjModel_* m, const CandidatePair& pair);
double gap_of(const mjModel_* m, const CandidatePair& pair);

// Whether MuJoCo has a collision for geoms of their types.
bool have_collision(const mjModel_* m, const CandidatePair& pair);

}  // namespace dashpot::host
