// The part of a convex hull that all but lies flat.
//
// The palm of a hand, the sole of a shoe or the bottom of a scanned bottle is some wide facets that
// lean on each other by some hundredths of a radian: none of them is a face to lie flat on
// (flat_faces.hpp), and what is pressed against them overlaps them all. Against a face or a plane
// they count like one, but for their heights. What both share has a corner of the surface of the
// hull in each corner of that, in each corner of the face and where ridges cross its sides: these
// are the points. Of a selection, the nearest, the deepest, MuJoCo's three on a plane, some come as
// others go by a hair of turn, and what rests on them rocks for good on what recovers of overlaps
// that no spring has taken up. Where there is no room for all, of fine meshes that are pressed
// flat, a tremble is left of that (docs/limits.md).

#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Tilt (rad) up to which a facet belongs to the cap.
inline constexpr double kShallow = 0.05;

// Tilt (rad) up to which other facets bound its height, where its outline spans notches of it:
// those that lean more are too narrow to matter, seen along the normal.
inline constexpr double kSteep = 0.2;

// A polygon of the surface of a hull.
struct HullFacet {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // outward
  double offset = 0.0;                               // of its plane along it, m
  std::vector<int> corner;                           // columns of HullSurface::corner
};

struct HullSurface {
  Eigen::Matrix3Xd corner;  // m, in its frame
  // By corner: its place in an order in which each of the first 256 is as far as can be from all
  // before it.
  std::vector<int> place;
  std::vector<HullFacet> facet;  // sorted by the third component of their normals
};

// The hull of `vertices` (m) that these polygons, counterclockwise from outside, are the surface
// of; without those that have no area.
HullSurface hull_surface(const Eigen::Matrix3Xd& vertices,
                         const std::vector<std::vector<int>>& polygons);

// Kept by the thread: finding one allocates nothing once there was one as large.
class ShallowCap {
 public:
  // The facets that look against `up` (world, unit: out of what it lies on). Whether their outline
  // is `least_width` (m) wide; of a finely meshed ball it is not.
  bool find(const HullSurface& hull, const Pose& pose, const Eigen::Vector3d& up,
            double least_width);

  // Its corners within `margin` (m) of a plane through `origin` that looks along `up`.
  FaceManifold meet_plane(const Eigen::Vector3d& origin, double margin);
  // The points within `margin` (m) that it shares with a face that looks along `up`, along that:
  // the corners of what the two share of its surface. Where none of these is as deep to within
  // `tolerance` (m), `nearest` (world), which is a point of the face or beneath it.
  FaceManifold meet_face(const PlacedFace& face, double margin, const Eigen::Vector3d& nearest,
                         double tolerance);

 private:
  struct Plane {
    Eigen::Vector3d normal;  // outward, world
    double offset, slope;    // along it; of it along `up`

    double height_over(const Eigen::Vector3d& point) const {
      return (offset - normal.dot(point)) / slope;
    }
  };
  struct Corner {
    Eigen::Vector3d position;  // world, m
    int place;                 // see HullSurface
  };
  // Height of a plane over a segment: at its beginning, and to its end from there, m.
  struct Line {
    double height = -std::numeric_limits<double>::infinity(), rise = 0.0;
    double at(double part) const { return height + part * rise; }
  };
  // One that meets something, and its place among the corners.
  struct Point {
    FacePoint at;
    int place;
    // Whether it is the one to keep: if it touches, by its place, else by its distance.
    bool comes_before(const Point& other) const;
  };
  static constexpr int kFirst = -1;

  // How far the surface lies above a point, along `up`, m.
  double height_over(const Eigen::Vector3d& point) const;
  // The points of the part of a segment within the outline, seen along `up`, over which ridges
  // cross it no higher than `margin` (m) above it.
  const std::vector<Eigen::Vector3d>& cross_ridges(const Eigen::Vector3d& begin,
                                                   const Eigen::Vector3d& end, double margin);
  // Whether there is one over a place, seen along `up`.
  bool has_point_over(const Eigen::Vector3d& place) const;
  // The points found; of more than there is room for those that touch, farthest apart.
  void take_points(FaceManifold& manifold);

  std::vector<Plane> plane_;
  std::vector<Corner> corner_;
  std::vector<char> is_corner_;  // by corner of the hull
  double width_ = 0.0;           // of the outline, m
  // Its corners are farthest along directions that are fixed in the hull; its origin is the lowest.
  PlacedFace outline_;
  std::vector<Line> line_;  // by plane, of the last segment
  std::vector<Eigen::Vector3d> crossing_;
  std::vector<Point> point_;
};

}  // namespace dashpot
