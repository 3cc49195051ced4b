#include "dashpot/geometry/shallow_cap.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dashpot {

using Eigen::Vector3d;

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
      if (const double height = corner.dot(local_up); height < lowest) {
        lowest = height;
        outline_.origin = pose.position + pose.rotation * corner;
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
  for (int k = 0; k < kMostCorners / 2; ++k)
    if (reach[k] + reach[k + kMostCorners / 2] < least_width) return false;
  outline_.normal = -up;
  outline_.count = 0;
  for (int k = 0; k < kMostCorners; ++k)
    if (farthest[k] != farthest[(k + kMostCorners - 1) % kMostCorners])
      outline_.corner[outline_.count++] = pose.position + pose.rotation * farthest[k];
  return outline_.count > 2;
}

double ShallowCap::height_over(const Vector3d& point) const {
  double height = -std::numeric_limits<double>::infinity();
  for (const Plane& plane : plane_)
    height = std::max(height, (plane.offset - plane.normal.dot(point)) / plane.slope);
  return height;
}

FaceManifold meet_cap(const PlacedFace& face, const ShallowCap& cap, double margin,
                      const Vector3d& nearest, double tolerance) {
  const Vector3d& up = face.normal;
  // Puts a point midway between the face and what lies above or below it.
  const auto placed = [&](const Vector3d& point) {
    const Vector3d on_face = point - up.dot(point - face.origin) * up;
    FacePoint found;
    found.distance = cap.height_over(on_face);
    found.position = on_face + 0.5 * found.distance * up;
    return found;
  };
  FaceManifold manifold = meet_face(face, cap.outline(), std::numeric_limits<double>::infinity());
  double least = std::numeric_limits<double>::infinity();
  int count = 0;
  for (int i = 0; i < manifold.count; ++i) {
    const FacePoint point = placed(manifold.point[i].position);
    if (point.distance > margin) continue;
    least = std::min(least, point.distance);
    manifold.point[count++] = point;
  }
  manifold.count = count;
  const FacePoint deepest = placed(nearest);
  if (deepest.distance <= margin && deepest.distance < least - tolerance &&
      count < static_cast<int>(manifold.point.size()))
    manifold.point[manifold.count++] = deepest;
  return manifold;
}

}  // namespace dashpot
