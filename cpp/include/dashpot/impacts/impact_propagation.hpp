// Contacts that impacts within the step bring about.
//
// Detection knows how far every geom goes under the smooth forces of a step. What is hit in it goes
// farther, into a neighbour that it has no row with. So once the rows are solved every geom that
// has gone farther than detection allowed for is looked at. Where its way leads it into a geom that
// it has no contact with, or deeper into one than its contacts with it know of, as a plank that
// claps down on its other end, or a joint beyond a limit that was not found, the step is taken anew
// with a reach that covers that way; a blow that runs on through many bodies takes as many turns.
// Pairs that detection looked for less far, since their geoms go together, are looked at where they
// went farther against each other.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/broadphase.hpp"
#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/detect/narrowing.hpp"
#include "dashpot/detect/reach.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class ImpactPropagation {
 public:
  // Whether motion at `mean_velocity` (nv) over a step of `length` (s) comes to contacts or limits
  // that are not among `contacts`, whose gaps at its end are `end_gap`, or were not within `reach`,
  // which is widened then, or that of `narrowed` pairs.
  bool comes_to_more(const mjModel_* model, const mjData_* data,
                     const std::vector<double>& mean_velocity, double length,
                     const std::vector<ContactInput>& contacts, const std::vector<double>& end_gap,
                     const std::vector<host::NarrowedPair>& narrowed, host::ReachBuffers& reach);

 private:
  // A narrowed pair whose geoms went farther against each other than they were looked for.
  struct Astray {
    std::array<int, 2> geom;
    double margin = 0.0, way = 0.0;  // m
  };
  // A contact of a pair, and its gap (m) at the end of the step.
  struct Known {
    GeomPair geom;
    double end_gap = 0.0;
    const ContactInput* contact = nullptr;
  };
  void find_displacements(const mjModel_* model, const mjData_* data,
                          const std::vector<double>& mean_velocity, double length,
                          const host::ReachBuffers& reach);
  void find_astray(const mjModel_* model, const mjData_* data, double length,
                   const std::vector<host::NarrowedPair>& narrowed);
  void find_known(const std::vector<ContactInput>& contacts, const std::vector<double>& end_gap);
  bool meets(const mjModel_* model, const mjData_* data, int geom1, int geom2, double margin,
             double way, double length);

  GeomShapes shapes_;
  std::vector<double> body_velocity_, displacement_;  // spatial; by geom, m
  std::vector<int> far_;         // geoms that went beyond their reach, ascending
  host::Broadphase broadphase_;  // of these
  std::vector<Astray> astray_;
  std::vector<int> asked_;    // geoms of either, ascending
  std::vector<Known> known_;  // of these, sorted by geoms, the deepest of each first
};

}  // namespace dashpot
