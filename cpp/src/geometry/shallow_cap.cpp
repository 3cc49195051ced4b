#include "dashpot/geometry/shallow_cap.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Fraction of the width of a cap between points that are one.
constexpr double kSamePlace = 1e-5;
// Fraction of a segment that leads beyond a side.
constexpr double kHair = 1e-9;
// Fraction of the radius of a hull up to which corners are in one plane.
constexpr double kOnePlane = 2e-5;

// Whether a point lies to the left of all sides of a face, seen from outside.
bool is_over(const PlacedFace& face, const Vector3d& point) {
  for (int side = 0; side < face.count; ++side) {
    const Vector3d& begin = face.corner[side];
    const Vector3d& end = face.corner[(side + 1) % face.count];
    if ((end - begin).cross(point - begin).dot(face.normal) < 0.0) return false;
  }
  return true;
}

}  // namespace

bool ShallowCap::find(const CoarseHull& hull, const Pose& pose, const Vector3d& up,
                      double least_width) {
  if (hull.facet.empty()) return false;
  hull_ = &hull;
  pose_ = pose;
  up_ = pose.rotation.transpose() * up;
  int axis = 0;
  up_.cwiseAbs().minCoeff(&axis);
  const Vector3d x = (Vector3d::Unit(axis) - up_[axis] * up_).normalized();
  const Vector3d y = x.cross(up_);  // counterclockwise seen from outside
  lowest_ = hull.farthest(-up_, 0);
  for (int i = hull.around_begin[lowest_]; i < hull.around_begin[lowest_ + 1]; ++i)
    if (looks_down(facet_ = hull.around[i])) break;
  // The corner of the cap that is farthest along a direction is the lowest of the hull tilted so.
  std::array<int, kMostCorners> farthest;
  width_ = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMostCorners / 2; ++k) {
    const double angle = 2.0 * EIGEN_PI * k / kMostCorners;
    const Vector3d along = std::cos(angle) * x + std::sin(angle) * y;
    const Vector3d down = -std::cos(kShallow) * up_, aside = std::sin(kShallow) * along;
    const int near = hull.farthest(down + aside, lowest_);
    const int far = hull.farthest(down - aside, lowest_);
    farthest[k] = near;
    farthest[k + kMostCorners / 2] = far;
    width_ = std::min(width_, along.dot(hull.corner.col(near) - hull.corner.col(far)));
    if (width_ < least_width) return false;
  }
  outline_.normal = -up;
  outline_.origin = pose.position + pose.rotation * hull.corner.col(lowest_);
  outline_.count = 0;
  for (int k = 0; k < kMostCorners; ++k)
    if (farthest[k] != farthest[(k + kMostCorners - 1) % kMostCorners])
      outline_.corner[outline_.count++] =
          pose.position + pose.rotation * hull.corner.col(farthest[k]);
  return outline_.count > 2;
}

bool ShallowCap::is_of_cap(int corner) const {
  const double steep = std::cos(kShallow);
  bool found = false;
  hull_->for_around(corner, [&](const HullFacet& facet) {
    const Vector3d area = hull_->doubled_area(facet);
    found = found || area.dot(up_) <= -steep * area.norm();
  });
  return found;
}

// Those lower than any height hang together: a walk from the lowest one meets them all.
template <typename Keep>
void ShallowCap::add_corners(const Vector3d& origin, double margin, const Keep& keep) {
  is_met_.assign(hull_->corner.cols(), 0);
  corner_.assign(1, lowest_);
  is_met_[lowest_] = 1;
  for (size_t i = 0; i < corner_.size(); ++i) {
    const int corner = corner_[i];
    const Vector3d position = pose_.position + pose_.rotation * hull_->corner.col(corner);
    const double distance = -outline_.normal.dot(position - origin);
    if (distance > margin || !is_of_cap(corner)) continue;
    if (keep(position)) point_.push_back({position + 0.5 * distance * outline_.normal, distance});
    hull_->for_next(corner, [&](int next) {
      if (is_met_[next]) return;
      is_met_[next] = 1;
      corner_.push_back(next);
    });
  }
}

bool ShallowCap::looks_down(int facet) const {
  return hull_->doubled_area(hull_->facet[facet]).dot(up_) < 0.0;
}

double ShallowCap::inside_of(const HullFacet& facet, int k, const Vector3d& point) const {
  const Vector3d begin = hull_->corner.col(facet.corner[k]);
  const Vector3d end = hull_->corner.col(facet.corner[(k + 1) % 3]);
  return (point - begin).cross(end - begin).dot(up_);
}

double ShallowCap::height_over(const HullFacet& facet, const Vector3d& point) const {
  const Vector3d area = hull_->doubled_area(facet);
  return area.dot(hull_->corner.col(facet.corner[0]) - point) / area.dot(up_);
}

// Seen along `up` the facets below are a regular triangulation, in which such a walk ends.
int ShallowCap::facet_over(const Vector3d& point) {
  for (size_t steps = 0; steps < hull_->facet.size(); ++steps) {
    const HullFacet& facet = hull_->facet[facet_];
    int k = 0;
    while (k < 3 && (inside_of(facet, k, point) >= 0.0 || !looks_down(facet.across[k]))) ++k;
    if (k == 3) break;
    facet_ = facet.across[k];
  }
  return facet_;
}

const std::vector<Vector3d>& ShallowCap::cross_ridges(const Vector3d& begin, const Vector3d& end,
                                                      double margin) {
  crossing_.clear();
  double first = 0.0, last = 1.0;
  for (int side = 0; side < outline_.count; ++side) {
    const Vector3d& corner = outline_.corner[side];
    const Vector3d inward =
        outline_.normal.cross(outline_.corner[(side + 1) % outline_.count] - corner);
    const double at_begin = inward.dot(begin - corner), at_end = inward.dot(end - corner);
    if (at_begin < 0.0 && at_end < 0.0) return crossing_;
    if (at_begin < 0.0) first = std::max(first, at_begin / (at_begin - at_end));
    if (at_end < 0.0) last = std::min(last, at_begin / (at_begin - at_end));
  }
  if (first >= last) return crossing_;
  const auto local = [&](double part) -> Vector3d {
    return pose_.rotation.transpose() * (begin + part * (end - begin) - pose_.position);
  };
  const Vector3d local_begin = local(0.0), local_end = local(1.0);
  // Whether two facets are one, which was cut in two.
  const auto is_flat = [&](const HullFacet& facet, const HullFacet& next) {
    const Vector3d normal = hull_->doubled_area(facet).normalized();
    return (normal.transpose() * hull_->corner(Eigen::all, next.corner)).minCoeff() >
           normal.dot(hull_->corner.col(facet.corner[0])) - kOnePlane * hull_->radius;
  };
  // From facet to facet, each time from a hair beyond the side through which the segment leaves.
  for (;;) {
    const HullFacet& here = hull_->facet[facet_over(local(first))];
    double leaves = last;
    int next = -1;
    for (int k = 0; k < 3; ++k) {
      const double at_begin = inside_of(here, k, local_begin);
      const double at_end = inside_of(here, k, local_end);
      if (at_end >= at_begin) continue;
      const double part = at_begin / (at_begin - at_end);
      if (part <= first || part >= leaves) continue;
      leaves = part;
      next = here.across[k];
    }
    if (next < 0) break;
    if (height_over(here, local(leaves)) <= margin && !is_flat(here, hull_->facet[next]))
      crossing_.push_back(begin + leaves * (end - begin));
    first = leaves + kHair;
  }
  return crossing_;
}

bool ShallowCap::has_point_over(const Vector3d& place) const {
  return std::any_of(point_.begin(), point_.end(), [&](const FacePoint& other) {
    return outline_.normal.cross(other.position - place).norm() <= kSamePlace * width_;
  });
}

void ShallowCap::take_points(FaceManifold& manifold) {
  if (point_.size() > kMostPoints) {
    std::nth_element(
        point_.begin(), point_.begin() + kMostPoints, point_.end(),
        [](const FacePoint& a, const FacePoint& b) { return a.distance < b.distance; });
    point_.resize(kMostPoints);
  }
  for (const FacePoint& point : point_) manifold.point[manifold.count++] = point;
}

FaceManifold ShallowCap::meet_plane(const Vector3d& origin, double margin) {
  FaceManifold manifold;
  manifold.normal = -outline_.normal;
  point_.clear();
  add_corners(origin, margin, [](const Vector3d&) { return true; });
  take_points(manifold);
  return manifold;
}

FaceManifold ShallowCap::meet_face(const PlacedFace& face, double margin, const Vector3d& nearest,
                                   double tolerance) {
  const Vector3d& up = face.normal;
  FaceManifold manifold;
  manifold.normal = up;
  point_.clear();
  add_corners(face.origin, margin, [&](const Vector3d& point) { return is_over(face, point); });
  const auto* const first = outline_.corner.data();
  if (std::all_of(first, first + outline_.count,
                  [&](const Vector3d& corner) { return is_over(face, corner); })) {
    take_points(manifold);
    return manifold;
  }
  const FaceManifold outline =
      dashpot::meet_face(face, outline_, std::numeric_limits<double>::infinity());
  const auto on_face = [&](const Vector3d& point) -> Vector3d {
    return point - up.dot(point - face.origin) * up;
  };
  // The point over one of the face, midway between that and what lies above or below it.
  const auto point_over = [&](const Vector3d& place) {
    const Vector3d local = pose_.rotation.transpose() * (place - pose_.position);
    const double distance = height_over(hull_->facet[facet_over(local)], local);
    return FacePoint{place + 0.5 * distance * up, distance};
  };
  const auto add_over = [&](const Vector3d& place) {
    if (has_point_over(place)) return;
    const FacePoint point = point_over(place);
    if (point.distance <= margin) point_.push_back(point);
  };
  for (int i = 0; i < outline.count; ++i) add_over(on_face(outline.point[i].position));
  for (int side = 0; side < face.count; ++side)
    for (const Vector3d& crossing :
         cross_ridges(face.corner[side], face.corner[(side + 1) % face.count], margin))
      add_over(crossing);
  const FacePoint found = point_over(on_face(nearest));
  if (std::all_of(
          point_.begin(), point_.end(),
          [&](const FacePoint& point) { return found.distance < point.distance - tolerance; }) &&
      found.distance <= margin && !has_point_over(found.position))
    point_.push_back(found);
  take_points(manifold);
  return manifold;
}

}  // namespace dashpot
