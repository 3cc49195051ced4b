// Convex bodies that lie flat on each other: the points of their faces.
//
// MuJoCo gives all the points that two faces of boxes share where the axis that separates the boxes
// farthest is the normal of a face, and a single point where it is the one across two edges. Of
// boxes tilted against each other by a hair it is: along the normal of a face a corner of the other
// box is lowest that stands out over the side, with nothing beneath it, and a tower rattles for
// good. Of meshes it gives up to four of the points, other ones from step to step.
//
// The points of the faces, all of them, are the better answer. Seen along the normal n of one face
// they are the corners of the intersection of both, which sides of the faces that cross are, too;
// and with z the height of one edge over the other there, their distance is z (n e) along the axis
// e across both. Of the flat end of a cylinder points of the rim are the corners, of a round side
// that lies on a face both ends of its lowest line.

#pragma once

#include <Eigen/Core>
#include <array>

#include "dashpot/geometry/flat_faces.hpp"
#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Fixed points of the rim of a cylinder's end. Tilted, its lowest point replaces the nearest.
inline constexpr int kCapCorners = 6;

// A face in the world.
struct PlacedFace {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // outward
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // a point of its plane
  std::array<Eigen::Vector3d, kMostCorners> corner;  // in order, counterclockwise from outside
  int count = 0;
};

// The face of a box of the half-lengths `half` that looks along `direction` (world).
PlacedFace place_box_face(const Eigen::Vector3d& half, const Pose& pose,
                          const Eigen::Vector3d& direction);

// A face of a hull.
PlacedFace place_face(const FlatFace& face, const Pose& pose);

// The flat end of a cylinder that looks along `direction` (world): kCapCorners points of its rim,
// fixed to it but for the lowest one along `up` (world, unit) where it is tilted.
PlacedFace place_cap(double radius, double half_length, const Pose& pose,
                     const Eigen::Vector3d& direction, const Eigen::Vector3d& up);

// The line of a round side that is lowest along `up` (world, unit), its ends as corners. Beyond
// them a capsule has half a ball, in which the lowest points are those beneath the ends.
PlacedFace place_side(double radius, double half_length, bool capsule, const Pose& pose,
                      const Eigen::Vector3d& up);

// Of two faces at most twice as many as one has corners, of a cap (shallow_cap.hpp) more; MuJoCo
// has room for 50 of a pair.
inline constexpr int kMostPoints = 48;

struct FacePoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // midway between both surfaces, m, world
  double distance = 0.0;                               // along the normal, m
};

struct FaceManifold {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  std::array<FacePoint, kMostPoints> point;
  int count = 0;
  int dropped = 0;  // flat crossings, see meet_face
};

// Whether the first of two faces separates them farther, along its normal.
bool separates_farther(const PlacedFace& first, const PlacedFace& second);

// The points within `margin` (m) that a face shares with another one, or with an edge of it, their
// distances along the normal of the first. Along that normal. Without corners where edges cross
// that stand out no more than `flat_crossing`, a fraction of the first face's radius, over the line
// between their neighbours: nothing rests on them that these do not bear.
FaceManifold meet_face(const PlacedFace& reference, const PlacedFace& other, double margin,
                       double flat_crossing = 0.0);

// The corners of a face within `margin` (m) of a plane through `origin`, `normal` out of it.
FaceManifold meet_plane(const Eigen::Vector3d& origin, const Eigen::Vector3d& normal,
                        const PlacedFace& face, double margin);

}  // namespace dashpot
