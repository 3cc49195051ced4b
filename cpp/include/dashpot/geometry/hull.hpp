// The convex hull of points, as the support function sees it.

#pragma once

#include <Eigen/Core>

#include "dashpot/lanes/aligned.hpp"

namespace dashpot {

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
  // The corner that is furthest along a direction (any length), the first of several. Not of a hull
  // without corners.
  Eigen::Vector3d furthest_along(const Eigen::Vector3d& direction) const;
  // Radius (m) of the smallest ball about the origin that holds it.
  double extent() const { return extent_; }

 private:
  int count_ = 0;
  double extent_ = 0.0;
  // Coordinates apart, the last corner repeated up to a multiple of kLanes.
  AlignedDoubles x_, y_, z_;
};

}  // namespace dashpot
