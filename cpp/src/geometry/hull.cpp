#include "dashpot/geometry/hull.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Index of the first of the points that are furthest along (dx, dy, dz); `count` is a multiple of
// kLanes, at least one.
DASHPOT_VECTOR_CLONES
int find_furthest(const double* x, const double* y, const double* z, int count, double dx,
                  double dy, double dz) {
  Lanes furthest = all_lanes(-std::numeric_limits<double>::infinity());
  Lanes where{}, at{0.0, 1.0, 2.0, 3.0};
  for (int i = 0; i < count; i += kLanes) {
    const Lanes height = dx * load_lanes(x + i) + dy * load_lanes(y + i) + dz * load_lanes(z + i);
    const LaneMask further = height > furthest;
    furthest = select(further, height, furthest);
    where = select(further, at, where);
    at += static_cast<double>(kLanes);
  }
  int best = 0;
  for (int lane = 1; lane < kLanes; ++lane)
    if (furthest[lane] > furthest[best] ||
        (furthest[lane] == furthest[best] && where[lane] < where[best]))
      best = lane;
  return static_cast<int>(where[best]);
}

}  // namespace

void Hull::set(const Eigen::Ref<const Eigen::Matrix3Xd>& corners) {
  count_ = static_cast<int>(corners.cols());
  for (AlignedDoubles* coordinate : {&x_, &y_, &z_}) coordinate->resize(padded(count_));
  for (int i = 0; i < padded(count_); ++i) {
    const auto corner = corners.col(std::min(i, count_ - 1));
    x_[i] = corner.x();
    y_[i] = corner.y();
    z_[i] = corner.z();
  }
  extent_ = count_ > 0 ? corners.colwise().norm().maxCoeff() : 0.0;
}

bool Hull::is_finite() const {
  const auto finite = [](double value) { return std::isfinite(value); };
  for (const AlignedDoubles* coordinate : {&x_, &y_, &z_})
    if (!std::all_of(coordinate->begin(), coordinate->end(), finite)) return false;
  return true;
}

Vector3d Hull::furthest_along(const Vector3d& direction) const {
  return corner(find_furthest(x_.data(), y_.data(), z_.data(), padded(count_), direction.x(),
                              direction.y(), direction.z()));
}

}  // namespace dashpot
