// Faces of a convex hull on which it can lie flat.
//
// The vertices of a face lie in one plane to within what rounding leaves of them, in a file with
// five digits or in single precision: polygons that this tore apart are one face again. A face
// counts up to half the angle to the plane of the flattest face next to it, where both are equally
// far; and only where that tilt lifts its far side by a fraction of the hull's size that contacts
// are not pressed in by, so that nothing jumps where it ceases to count. The facets of a finely
// meshed ball are not such faces.

#pragma once

#include <Eigen/Core>
#include <vector>

#include "dashpot/geometry/hull.hpp"

namespace dashpot {

// Corners that stand for a face: of a circle's corners they leave out 3 % of the radius at most.
// Contacts of two such faces are twice as many.
inline constexpr int kMostCorners = 12;
// Tilt (rad) up to which a face counts at all: MuJoCo, too, lets the normal of a box's face stand
// for the axis across two edges up to a cosine of 0.99 where both overlap by about the same.
inline constexpr double kMostTilt = 0.1415;

struct FlatFace {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // outward, in the frame of the hull
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // a point of its plane
  double cosine = 1.0;                               // of the tilt up to which it counts
  // Counterclockwise seen from outside. Of many those that are farthest along directions fixed in
  // the face, so that none of them ever gives way to another one.
  std::vector<Eigen::Vector3d> corner;
};

std::vector<FlatFace> flat_faces(const CoarseHull& hull);

// The face whose normal is nearest to `direction` (unit, hull's frame); null where there is none.
const FlatFace* face_along(const std::vector<FlatFace>& faces, const Eigen::Vector3d& direction);

}  // namespace dashpot
