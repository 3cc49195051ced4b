// The part of a convex hull that all but lies flat.
//
// The palm of a hand, the sole of a shoe or the bottom of a scanned bottle is some wide facets that
// lean on each other by some hundredths of a radian: none of them is a face to lie flat on
// (flat_faces.hpp), and what is pressed against them overlaps them all. Against a face or a plane
// they count like one, but for their heights. What both share has a corner of the surface of the
// hull in each corner of that, in each corner of the face and where ridges cross its sides: these
// are the points. Of a selection some come as others go by a hair of turn, and what rests on them
// rocks for good. So that there is room for all, also of fine meshes, their hull is a coarse one.

#pragma once

#include <Eigen/Core>
#include <vector>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/hull.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Tilt (rad) up to which a facet belongs to the cap.
inline constexpr double kShallow = 0.05;

// Kept by the thread: finding one allocates nothing once there was one as large.
class ShallowCap {
 public:
  // The facets that look against `up` (world, unit: out of what it lies on). Whether their outline
  // is `least_width` (m) wide; of a finely meshed ball it is not. The hull must outlive it.
  bool find(const CoarseHull& hull, const Pose& pose, const Eigen::Vector3d& up,
            double least_width);

  // Its corners within `margin` (m) of a plane through `origin` that looks along `up`.
  FaceManifold meet_plane(const Eigen::Vector3d& origin, double margin);
  // The points within `margin` (m) that it shares with a face that looks along `up`, along that:
  // the corners of what the two share of its surface. Where none of these is as deep to within
  // `tolerance` (m), `nearest` (world), which is a point of the face or beneath it.
  FaceManifold meet_face(const PlacedFace& face, double margin, const Eigen::Vector3d& nearest,
                         double tolerance);

 private:
  // Adds the corners within `margin` (m) of a plane that `keep` lets in.
  template <typename Keep>
  void add_corners(const Eigen::Vector3d& origin, double margin, const Keep& keep);
  // Whether a corner is one of a facet that all but lies flat.
  bool is_of_cap(int corner) const;
  bool looks_down(int facet) const;
  // How far a point lies inside the side of a facet from its corner k, along `up`; to one scale.
  double inside_of(const HullFacet& facet, int k, const Eigen::Vector3d& point) const;
  // How far a facet's plane lies above a point, along `up`, m.
  double height_over(const HullFacet& facet, const Eigen::Vector3d& point) const;
  // The facet over a point (in the frame of the hull), in a walk from the last one.
  int facet_over(const Eigen::Vector3d& point);
  // The points of the part of a segment within the outline, seen along `up`, over which ridges
  // cross it no higher than `margin` (m) above it.
  const std::vector<Eigen::Vector3d>& cross_ridges(const Eigen::Vector3d& begin,
                                                   const Eigen::Vector3d& end, double margin);
  // Whether there is one over a place, seen along `up`.
  bool has_point_over(const Eigen::Vector3d& place) const;
  // The points found; of more than there is room for the deepest.
  void take_points(FaceManifold& manifold);

  const CoarseHull* hull_ = nullptr;
  Pose pose_;
  Eigen::Vector3d up_ = Eigen::Vector3d::Zero();  // in the frame of the hull
  int lowest_ = 0;                                // corner
  int facet_ = 0;                                 // the last one found over a point
  double width_ = 0.0;                            // of the outline, m
  // Its corners are farthest along directions that are fixed in the hull; its origin is the lowest.
  PlacedFace outline_;
  std::vector<int> corner_;  // met in a walk
  std::vector<char> is_met_;
  std::vector<Eigen::Vector3d> crossing_;
  std::vector<FacePoint> point_;
};

}  // namespace dashpot
