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
constexpr double kSamePlace = 1e-7;

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

std::vector<HullFacet> hull_facets(const Eigen::Matrix3Xd& vertices,
                                   const std::vector<std::vector<int>>& polygons) {
  std::vector<HullFacet> facets;
  for (const std::vector<int>& polygon : polygons) {
    HullFacet facet;
    for (int vertex : polygon) facet.corner.push_back(vertices.col(vertex));
    Vector3d area = Vector3d::Zero();
    for (size_t i = 2; i < facet.corner.size(); ++i)
      area += (facet.corner[i - 1] - facet.corner[0]).cross(facet.corner[i] - facet.corner[0]);
    if (area.norm() == 0.0) continue;
    facet.normal = area.normalized();
    facet.offset = -std::numeric_limits<double>::infinity();
    for (const Vector3d& corner : facet.corner)
      facet.offset = std::max(facet.offset, facet.normal.dot(corner));
    facets.push_back(std::move(facet));
  }
  std::sort(facets.begin(), facets.end(),
            [](const HullFacet& a, const HullFacet& b) { return a.normal.z() < b.normal.z(); });
  return facets;
}

bool ShallowCap::find(const std::vector<HullFacet>& facets, const Pose& pose, const Vector3d& up,
                      double least_width) {
  const Vector3d local_up = pose.rotation.transpose() * up;
  int axis = 0;
  local_up.cwiseAbs().minCoeff(&axis);
  const Vector3d x = (Vector3d::Unit(axis) - local_up[axis] * local_up).normalized();
  const Vector3d y = x.cross(local_up);  // counterclockwise seen from outside
  std::array<Vector3d, kMostCorners> direction, farthest;
  std::array<double, kMostCorners> reach;
  reach.fill(-std::numeric_limits<double>::infinity());
  for (int k = 0; k < kMostCorners; ++k) {
    const double angle = 2.0 * EIGEN_PI * k / kMostCorners;
    direction[k] = std::cos(angle) * x + std::sin(angle) * y;
  }
  const double cosine = std::cos(kShallow);
  plane_.clear();
  corner_.clear();
  double lowest = std::numeric_limits<double>::infinity();
  // Unit vectors that are kShallow apart differ by less than that in each coordinate.
  const auto first =
      std::lower_bound(facets.begin(), facets.end(), -local_up.z() - kShallow,
                       [](const HullFacet& facet, double z) { return facet.normal.z() < z; });
  for (auto it = first; it != facets.end() && it->normal.z() <= -local_up.z() + kShallow; ++it) {
    const HullFacet& facet = *it;
    const double slope = facet.normal.dot(local_up);
    if (slope > -cosine) continue;
    const Vector3d normal = pose.rotation * facet.normal;
    plane_.push_back({normal, facet.offset + normal.dot(pose.position), slope});
    for (const Vector3d& corner : facet.corner) {
      corner_.push_back(pose.position + pose.rotation * corner);
      if (const double height = corner.dot(local_up); height < lowest) {
        lowest = height;
        outline_.origin = corner_.back();
      }
      for (int k = 0; k < kMostCorners; ++k) {
        const double along = corner.dot(direction[k]);
        if (along <= reach[k]) continue;
        reach[k] = along;
        farthest[k] = corner;
      }
    }
  }
  if (plane_.empty()) return false;
  width_ = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMostCorners / 2; ++k)
    width_ = std::min(width_, reach[k] + reach[k + kMostCorners / 2]);
  if (width_ < least_width) return false;
  outline_.normal = -up;
  outline_.count = 0;
  for (int k = 0; k < kMostCorners; ++k)
    if (farthest[k] != farthest[(k + kMostCorners - 1) % kMostCorners])
      outline_.corner[outline_.count++] = pose.position + pose.rotation * farthest[k];
  return outline_.count > 2;
}

const ShallowCap::Plane& ShallowCap::highest_over(const Vector3d& point) const {
  return *std::max_element(plane_.begin(), plane_.end(), [&](const Plane& a, const Plane& b) {
    return a.height_over(point) < b.height_over(point);
  });
}

double ShallowCap::height_over(const Vector3d& point) const {
  return highest_over(point).height_over(point);
}

std::optional<Vector3d> ShallowCap::lowest_corner_over(const PlacedFace& face) const {
  std::optional<Vector3d> lowest;
  double least = std::numeric_limits<double>::infinity();
  for (const Vector3d& corner : corner_) {
    const double height = -outline_.normal.dot(corner);
    if (height >= least || !is_over(face, corner)) continue;
    least = height;
    lowest = corner;
  }
  return lowest;
}

// Where the planes that are highest over both ends cross, unless another is higher there, which
// then takes the place of the one on its side: of convex heights each does once at most.
std::optional<Vector3d> ShallowCap::lowest_between(const Vector3d& begin,
                                                   const Vector3d& end) const {
  double first = 0.0, last = 1.0;
  for (int side = 0; side < outline_.count; ++side) {
    const Vector3d& corner = outline_.corner[side];
    const Vector3d inward =
        outline_.normal.cross(outline_.corner[(side + 1) % outline_.count] - corner);
    const double at_begin = inward.dot(begin - corner), at_end = inward.dot(end - corner);
    if (at_begin < 0.0 && at_end < 0.0) return std::nullopt;
    if (at_begin < 0.0) first = std::max(first, at_begin / (at_begin - at_end));
    if (at_end < 0.0) last = std::min(last, at_begin / (at_begin - at_end));
  }
  if (first >= last) return std::nullopt;
  const auto at = [&](double part) { return Vector3d(begin + part * (end - begin)); };
  const auto rise = [&](const Plane& plane) {
    return -plane.normal.dot(end - begin) / plane.slope;
  };
  const Plane *falling = &highest_over(at(first)), *rising = &highest_over(at(last));
  if (rise(*falling) >= 0.0 || rise(*rising) <= 0.0) return std::nullopt;
  double part = first;
  for (size_t taken = 0; taken < plane_.size(); ++taken) {
    part = (falling->height_over(begin) - rising->height_over(begin)) /
           (rise(*rising) - rise(*falling));
    const Plane& highest = highest_over(at(part));
    if (&highest == falling || &highest == rising || rise(highest) == 0.0) break;
    (rise(highest) < 0.0 ? falling : rising) = &highest;
  }
  return at(part);
}

FaceManifold meet_cap(const PlacedFace& face, const ShallowCap& cap, double margin,
                      const Vector3d& nearest, double tolerance) {
  const Vector3d& up = face.normal;
  const FaceManifold outline =
      meet_face(face, cap.outline(), std::numeric_limits<double>::infinity());
  FaceManifold manifold;
  manifold.normal = outline.normal;
  double least = std::numeric_limits<double>::infinity();
  // Adds the point over another one, midway between the face and what lies above or below it, if it
  // is `deeper` than all by so much and no other is there.
  const auto add = [&](const Vector3d& point, double deeper) {
    const Vector3d on_face = point - up.dot(point - face.origin) * up;
    FacePoint found;
    found.distance = cap.height_over(on_face);
    found.position = on_face + 0.5 * found.distance * up;
    if (found.distance > margin || found.distance >= least - deeper) return;
    for (int i = 0; i < manifold.count; ++i)
      if ((manifold.point[i].position - found.position).norm() <= kSamePlace * cap.width()) return;
    manifold.point[manifold.count++] = found;
  };
  const double any = -std::numeric_limits<double>::infinity();
  for (int i = 0; i < outline.count; ++i) add(outline.point[i].position, any);
  for (int side = 0; side < face.count; ++side)
    if (const auto lowest =
            cap.lowest_between(face.corner[side], face.corner[(side + 1) % face.count]))
      add(*lowest, any);
  if (const auto corner = cap.lowest_corner_over(face)) add(*corner, any);
  for (int i = 0; i < manifold.count; ++i) least = std::min(least, manifold.point[i].distance);
  add(nearest, tolerance);
  return manifold;
}

}  // namespace dashpot
