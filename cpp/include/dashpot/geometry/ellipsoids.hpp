// Where two ellipsoids are nearest, or overlap least.
//
// An ellipsoid of the half-axes a, turned by R, reaches h = sqrt(n' S n) along a unit direction n,
// S = R diag(a^2) R', in the point grad h = S n / h. With the centres c apart, the surfaces are
//
//     s(n) = n (c - grad h_1 - grad h_2)
//
// apart along n, and the distance, negative in overlap, is the largest of these. There the vector
// between both points lies along n: its part t across n vanishes, and by Newton
//
//     (H_1 + H_2 + s) dn = t ,   H = (S - grad h grad h') / h ,
//
// in the plane across n. A search for the nearest points by hulls ends with a tolerance on s, whose
// root is left of n: of two balls in overlap it was off by up to 0.05 rad.

#pragma once

#include <Eigen/Core>

#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Normal from the first to the second, and the point of the first; lengths in m.
struct EllipsoidContact {
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double distance = 0.0;
};

// Two ellipsoids of half-axes `half` (m, > 0) in their poses.
struct EllipsoidPair {
  Eigen::Vector3d half1, half2;
  Pose pose1, pose2;
};

// Improves a normal that is about right. False, and `contact` unchanged, where Newton's steps do
// not end: nearly concentric ones have no normal.
bool find_contact(const EllipsoidPair& pair, const Eigen::Vector3d& normal,
                  EllipsoidContact& contact);

}  // namespace dashpot
