// The round surfaces with which geoms touch terrain: a ball's, an ellipsoid's, those of the ends of
// a capsule.

#pragma once

#include <Eigen/Core>

#include "dashpot/geometry/shape.hpp"

struct mjModel_;

namespace dashpot::host {

class RoundSurfaces {
 public:
  RoundSurfaces(const mjModel_* m, int geom);

  int count() const { return count_; }  // 0 of geoms that touch with corners and rims
  // The lowest points of a surface, by the unit normal along which they are, where the geom is in
  // `pose`; both in the frame of that. Refers to the surfaces and the pose.
  auto lowest(int surface, const Pose& pose) const {
    return [this, surface, &pose](const Eigen::Vector3d& normal) {
      return lowest_along(normal, surface, pose);
    };
  }

 private:
  Eigen::Vector3d lowest_along(const Eigen::Vector3d& normal, int surface, const Pose& pose) const;

  Eigen::Vector3d half_;  // half-axes, m
  double half_length_ = 0.0;
  int count_ = 0;
};

}  // namespace dashpot::host
