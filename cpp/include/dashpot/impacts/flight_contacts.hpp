// Contacts of bodies that fly towards or past each other.
//
// Contacts that may start in a step are found at its start, as planes through the nearest points.
// Bodies that move far for their size meet elsewhere, along another normal; one that goes past
// another crosses the plane without touching anything. Of a pair of geoms that
//
// - is apart, and whose geoms move farther in the step than a fraction of the thinner one's
//   half-width, a smaller one where both are round: theirs turn the normal all the way; or which
//   closes in the step, and may pass an edge,
// - belongs to free, fixed or mocap bodies on which nothing else can act in the step: no
//   constraint, no contact that touches or closes, none that what it acts on may come to,
//
// the time of impact along their smooth motion is found. A pair without one in the step is a near
// miss: its contacts are left out, the next step finds them anew. Where the surfaces meet along a
// normal that the contacts found do not have, or where none of these closes, the nearest becomes
// the one of the impact, in the place that its two points have at the start.
//
// Planes have the same normal everywhere, and are left as found. So is the face of a tile for those
// that it goes on in, whose own contacts are left out (detect/internal_edges.hpp): a ball may
// fly past its end, and meet the next one.
//
// The pair is followed along the parabolas of the centres of mass to its time of impact
// (query.hpp), turning at the mean rates, with a clearance for what those leave out: with the
// angular accelerations alpha of the bodies and arms r about their centres, over the step H
//
//     (|alpha_1| r_1 + |alpha_2| r_2) H^2 / 8 .

#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/detect/reach.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// A pair whose contacts, from `first` to `last`, are all apart, and where its motion leads.
struct Flight {
  size_t first = 0, last = 0;
  bool misses = false, meets = false;  // neither: not followed
  // Of the impact: the normal; the points that meet, from the bodies' centres of mass at the start
  // on with the arms that they have then, and in the frames of their geoms; the gap at the start
  // from which the rates at those points lead to the impact.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  Eigen::Vector3d point[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d local[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  double gap = 0.0;
};

// Keeps its arrays from step to step.
class FlightContacts {
 public:
  // Corrects the contacts of a step of `length` (s), also in `data`. `reach`: of their detection.
  void follow(const mjModel_* model, mjData_* data, const host::ReachBuffers& reach,
              const std::vector<ConstraintInput>& constraints, double length,
              std::vector<ContactInput>& contacts);
  // Pairs whose contacts follow() left out, sorted.
  const std::vector<GeomPair>& near_misses() const { return misses_; }

 private:
  GeomShapes shapes_;
  std::vector<Flight> flights_, redirected_;
  std::vector<char> disturbed_;  // by tree
  std::vector<GeomPair> misses_;
};

}  // namespace dashpot
