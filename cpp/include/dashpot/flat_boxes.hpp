// Boxes that lie flat on each other: the points of their faces.
//
// MuJoCo gives all the points that two faces share where the axis that separates the boxes farthest
// is the normal of a face, and a single point where it is the one across two edges. Of boxes tilted
// against each other by a hair it is: along the normal of a face a corner of the other box is
// lowest that stands out over the side, with nothing beneath it. What rests on that one point tips
// over it until the next step finds the other points again, overlapping by then, and a tower
// rattles for good on what recovery of those overlaps puts in.
//
// The points of the faces are the better answer there, for the crossing is one of them. Seen along
// the normal n of one face they are the corners of the intersection of both, which sides of the
// faces that cross are, too; and with z the height of one edge over the other there, their distance
// is z (n e) along the axis e across both.

#pragma once

#include <Eigen/Core>
#include <array>

#include "dashpot/shape.hpp"

namespace dashpot {

struct PlacedBox {
  Pose pose;
  Eigen::Vector3d half = Eigen::Vector3d::Zero();  // half-lengths, m
};

struct FacePoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // midway between both surfaces, m, world
  double distance = 0.0;                               // along the normal, m
};

struct FaceManifold {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // from the first box to the second
  std::array<FacePoint, 8> point;  // four corners cut by four sides are eight at most
  int count = 0;
};

// The points within `margin` (m) that the faces share with which two boxes meet along `direction`
// (unit, from the first to the second), their distances along the normal of that face which
// separates the boxes farther. None where a face is tilted from `direction` by more than 8 degrees.
FaceManifold meet_flat(const PlacedBox& first, const PlacedBox& second,
                       const Eigen::Vector3d& direction, double margin);

}  // namespace dashpot
