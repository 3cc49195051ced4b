// What an MJCF says about contacts of two geoms.

#pragma once

#include <array>

#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjContact_;

namespace dashpot::host {

// Index of the <pair> that defines the contacts of two geoms, in any order; -1 for none.
int defining_pair(const mjModel_* m, int geom1, int geom2);

// Gaps (m) by geom, by <pair> and by flex: a model's own, or what they were before they were
// widened.
struct GapArrays {
  const double *geom, *pair, *flex;
};
// How far beyond its margin a contact is detected.
double gap_of(const mjModel_* m, const mjContact_& contact, const GapArrays& gaps);

// Of contacts of two geoms, and of those that a <pair> defines.
struct ContactParameters {
  int dim = 1;
  std::array<double, 5> friction{};
  std::array<double, 2> solref{};
  std::array<double, 2> solreffriction{};  // zeros: as solref
  std::array<double, 5> solimp{};
};
ContactParameters parameters_of_geoms(const mjModel_* m, int geom1, int geom2);
ContactParameters parameters_of_pair(const mjModel_* m, int pair);

// A contact of two geoms of a model, with all that the model says about it and no geometry: what
// MuJoCo gives the contacts that it detects between them.
ContactInput contact_of_pair(const mjModel_* m, int geom1, int geom2);

}  // namespace dashpot::host
