// Convex hulls: of points, and of few of a mesh's vertices, with walks on it.
//
// Scans and exports have thousands of vertices where some would do. Of a bottom that is all but
// flat, dozens lie within the depth of a contact: all touch, others from step to step, each one
// more contact to solve. Vertices that stand out by less than a twenty-thousandth of the radius do
// not count here, half of what those of one plane may be away from it (flat_faces.hpp). Contacts
// that are pressed in by as much touch in a few corners, however fine the mesh. Walks from corner
// to corner and from facet to facet find them, so that work does not follow the number of either.

#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "dashpot/lanes/aligned.hpp"

namespace dashpot {

// The convex hull of points, as the support function sees it.
class Hull {
 public:
  Hull() = default;
  // `corners` (m) in columns.
  explicit Hull(const Eigen::Ref<const Eigen::Matrix3Xd>& corners) { set(corners); }
  // Takes other corners; allocates only for more of them than ever before.
  void set(const Eigen::Ref<const Eigen::Matrix3Xd>& corners);

  int count() const { return count_; }
  Eigen::Vector3d corner(int index) const { return {x_[index], y_[index], z_[index]}; }
  bool is_finite() const;
  // The corner furthest along a direction (any length), the first of several. Not of an empty hull.
  Eigen::Vector3d furthest_along(const Eigen::Vector3d& direction) const;
  // Radius (m) of the smallest ball about the origin that holds it.
  double extent() const { return extent_; }

 private:
  int count_ = 0;
  double extent_ = 0.0;
  // Coordinates apart, the last corner repeated up to a multiple of kLanes.
  AlignedDoubles x_, y_, z_;
};

// A triangle of the surface.
struct HullFacet {
  std::array<int, 3> corner{};  // columns of CoarseHull::corner, counterclockwise from outside
  std::array<int, 3> across{};  // the facet beyond the edge from each of them to the next
};

struct CoarseHull {
  double radius = 0.0;      // about the middle of its bounds, m
  Eigen::Matrix3Xd corner;  // m, in its frame
  std::vector<HullFacet> facet;
  std::vector<int> around, around_begin;  // facets at each corner, corner by corner

  // Outward, as long as twice the area of a facet.
  Eigen::Vector3d doubled_area(const HullFacet& of) const;
  // Calls `see` for each facet at a corner.
  template <typename See>
  void for_around(int at, const See& see) const {
    for (int i = around_begin[at]; i < around_begin[at + 1]; ++i) see(facet[around[i]]);
  }
  // Calls `see` for each corner next to one.
  template <typename See>
  void for_next(int at, const See& see) const {
    for_around(at, [&](const HullFacet& here) {
      for (int k = 0; k < 3; ++k)
        if (here.corner[k] == at) see(here.corner[(k + 1) % 3]);
    });
  }
  // The corner that is farthest along a direction, in a walk from one.
  int farthest(const Eigen::Vector3d& direction, int from) const;
};

// The hull of some of these vertices (m); others stand out by a fraction of its radius at most
// (quickhull of Barber, Dobkin and Huhdanpaa, ended early). No facets where they span no volume.
CoarseHull coarse_hull(const Eigen::Matrix3Xd& vertices);

}  // namespace dashpot
