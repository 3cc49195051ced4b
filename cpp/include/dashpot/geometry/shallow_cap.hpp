// The part of a convex hull that all but lies flat.
//
// The palm of a hand, a foot or the sole of a shoe is a few wide facets that lean on each other by
// some hundredths of a radian: none of them is a face to lie flat on (flat_faces.hpp), and what is
// pressed against them overlaps them all. In a single contact, that of the nearest points, it has
// nothing to stand on: light things rock from one point to the other and go in on either side
// while the other is not held, or tip out. Against a face such facets count like one, but for their
// heights: the points that it shares with their outline, seen along its normal, lie as deep as the
// surface of the hull does there. Between these a convex hull can be deeper in a corner over the
// face and where ridges cross the sides of that, and these are points as well: from one end of a
// ridge that lies level to the other the deepest point alone jumps by a hair of turn.

#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Tilt (rad) up to which a facet belongs to the cap.
inline constexpr double kShallow = 0.05;

// A polygon of the surface of a hull, in its frame.
struct HullFacet {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // outward
  double offset = 0.0;                               // of its plane along it, m
  std::vector<Eigen::Vector3d> corner;
};

// Of the polygons of `vertices` (m), counterclockwise from outside, those that have an area, sorted
// by the third component of their normals.
std::vector<HullFacet> hull_facets(const Eigen::Matrix3Xd& vertices,
                                   const std::vector<std::vector<int>>& polygons);

// Kept by the thread: finding one allocates nothing once there was one as large.
class ShallowCap {
 public:
  // Those of hull_facets() that look against `up` (world, unit: out of what it lies on). Whether
  // their outline is `least_width` (m) wide; of a finely meshed ball it is not.
  bool find(const std::vector<HullFacet>& facets, const Pose& pose, const Eigen::Vector3d& up,
            double least_width);
  // Its corners are farthest along directions that are fixed in the hull; its origin is the lowest.
  const PlacedFace& outline() const { return outline_; }
  double width() const { return width_; }  // of the outline, m
  // How far the surface lies above a point, along `up`, m.
  double height_over(const Eigen::Vector3d& point) const;
  // The lowest of its corners that lie over a face, seen along `up`; none where none does.
  std::optional<Eigen::Vector3d> lowest_corner_over(const PlacedFace& face) const;
  // The point of the part of a segment within its outline, seen along `up`, over which it is
  // lowest; none where that is an end of the part.
  std::optional<Eigen::Vector3d> lowest_between(const Eigen::Vector3d& begin,
                                                const Eigen::Vector3d& end) const;

 private:
  struct Plane {
    Eigen::Vector3d normal;  // outward, world
    double offset, slope;    // along it; of it along `up`

    double height_over(const Eigen::Vector3d& point) const {
      return (offset - normal.dot(point)) / slope;
    }
  };
  const Plane& highest_over(const Eigen::Vector3d& point) const;

  std::vector<Plane> plane_;
  std::vector<Eigen::Vector3d> corner_;  // world, once for each of its facets
  double width_ = 0.0;                   // m
  PlacedFace outline_;
};

// The points within `margin` (m) that a face shares with a cap, found against the face's normal: of
// the outline, where ridges cross the sides of the face, and the deepest corner over it, however
// little deeper they are, for what comes and goes with that has nothing to rest on; and where none
// of these is as deep to within `tolerance` (m), `nearest` (world), which is a point of the face or
// beneath it.
FaceManifold meet_cap(const PlacedFace& face, const ShallowCap& cap, double margin,
                      const Eigen::Vector3d& nearest, double tolerance);

}  // namespace dashpot
