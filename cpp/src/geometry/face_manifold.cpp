#include "dashpot/geometry/face_manifold.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Fraction of the reference face's radius within which corners that clipping made are one.
constexpr double kSameCorner = 1e-7;
// Fraction of the radius of a cap by which its lowest point is lower than a fixed one, as much as
// vertices of one plane may be away from it.
constexpr double kLower = 1e-4;

// Height of the lowest corner of a face over the plane of another one.
double separation(const PlacedFace& face, const PlacedFace& other) {
  double lowest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < other.count; ++i)
    lowest = std::min(lowest, face.normal.dot(other.corner[i] - face.origin));
  return lowest;
}

// Corners in a plane, in order, their height over it, and whether edges cross there.
struct Polygon {
  std::array<Vector3d, 2 * kMostCorners> corner;
  std::array<bool, 2 * kMostCorners> crossing;
  int count = 0;
  void add(const Vector3d& point, bool crosses) {
    if (count == static_cast<int>(corner.size())) return;
    crossing[count] = crosses;
    corner[count++] = point;
  }
};

// What of a polygon lies left of the line from `begin` to `end` (Sutherland and Hodgman).
void clip(const Vector3d& begin, const Vector3d& end, Polygon& polygon) {
  const Vector3d side = end - begin;
  const double length = side.head<2>().norm();
  if (length == 0.0) return;
  const auto beyond = [&](const Vector3d& p) {
    return (side.y() * (p.x() - begin.x()) - side.x() * (p.y() - begin.y())) / length;
  };
  const Polygon in = polygon;
  polygon.count = 0;
  for (int i = 0; i < in.count; ++i) {
    const Vector3d &p = in.corner[i], &q = in.corner[i + 1 < in.count ? i + 1 : 0];
    const double at_p = beyond(p), at_q = beyond(q);
    if (at_p <= 0.0) polygon.add(p, in.crossing[i]);
    if (at_p * at_q < 0.0) polygon.add(p + at_p / (at_p - at_q) * (q - p), true);
  }
}

// Takes away crossings that stand out no more than `tolerance` (m) over the line between their
// neighbours: nothing rests on them that these do not bear.
void drop_flat_crossings(double tolerance, Polygon& polygon) {
  for (int i = 0; i < polygon.count && polygon.count > 3;) {
    const Vector3d& before = polygon.corner[i > 0 ? i - 1 : polygon.count - 1];
    const Vector3d line = polygon.corner[i + 1 < polygon.count ? i + 1 : 0] - before;
    const Vector3d arm = polygon.corner[i] - before;
    const double square = line.squaredNorm();
    const double along = square > 0.0 ? std::clamp(arm.dot(line) / square, 0.0, 1.0) : 0.0;
    if (!polygon.crossing[i] || (arm - along * line).norm() > tolerance) {
      ++i;
      continue;
    }
    std::copy(polygon.corner.begin() + i + 1, polygon.corner.begin() + polygon.count,
              polygon.corner.begin() + i);
    std::copy(polygon.crossing.begin() + i + 1, polygon.crossing.begin() + polygon.count,
              polygon.crossing.begin() + i);
    --polygon.count;
  }
}

}  // namespace

PlacedFace place_box_face(const Vector3d& half, const Pose& pose, const Vector3d& direction) {
  const Vector3d local = pose.rotation.transpose() * direction;
  int axis = 0;
  local.cwiseAbs().maxCoeff(&axis);
  PlacedFace face;
  const double sign = local[axis] < 0.0 ? -1.0 : 1.0;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const Vector3d along_u = half[u] * pose.rotation.col(u);
  const Vector3d along_v = sign * half[v] * pose.rotation.col(v);
  face.normal = sign * pose.rotation.col(axis);
  face.origin = pose.position + half[axis] * face.normal;
  face.corner[0] = face.origin + along_u + along_v;
  face.corner[1] = face.origin - along_u + along_v;
  face.corner[2] = face.origin - along_u - along_v;
  face.corner[3] = face.origin + along_u - along_v;
  face.count = 4;
  return face;
}

PlacedFace place_face(const FlatFace& face, const Pose& pose) {
  PlacedFace placed;
  placed.normal = pose.rotation * face.normal;
  placed.origin = pose.position + pose.rotation * face.origin;
  for (const Vector3d& corner : face.corner)
    placed.corner[placed.count++] = pose.position + pose.rotation * corner;
  return placed;
}

PlacedFace place_cap(double radius, double half_length, const Pose& pose, const Vector3d& direction,
                     const Vector3d& up) {
  constexpr double kPart = 2.0 * EIGEN_PI / kCapCorners;
  const double sign = pose.rotation.col(2).dot(direction) < 0.0 ? -1.0 : 1.0;
  const Vector3d x = radius * pose.rotation.col(0), y = sign * radius * pose.rotation.col(1);
  PlacedFace face;
  face.normal = sign * pose.rotation.col(2);
  face.origin = pose.position + half_length * face.normal;
  const auto on_rim = [&](double angle) -> Vector3d {
    return face.origin + std::cos(angle) * x + std::sin(angle) * y;
  };
  for (int i = 0; i < kCapCorners; ++i) face.corner[face.count++] = on_rim(kPart * i);
  // As far from the lowest point as a fixed one can be, is that one lower?
  const double lift = std::hypot(up.dot(x), up.dot(y)) * (1.0 - std::cos(0.5 * kPart));
  if (lift > kLower * radius) {
    const double lowest = std::atan2(-up.dot(y), -up.dot(x));
    const int nearest = static_cast<int>(std::lround(lowest / kPart)) + kCapCorners;
    face.corner[nearest % kCapCorners] = on_rim(lowest);
  }
  return face;
}

PlacedFace place_side(double radius, double half_length, bool capsule, const Pose& pose,
                      const Vector3d& up) {
  const Vector3d axis = pose.rotation.col(2);
  PlacedFace side;
  side.normal = -up;
  if (!capsule) side.normal = (axis.dot(up) * axis - up).normalized();
  side.origin = pose.position + radius * side.normal;
  for (double at : {-half_length, half_length}) side.corner[side.count++] = side.origin + at * axis;
  return side;
}

bool separates_farther(const PlacedFace& first, const PlacedFace& second) {
  return separation(first, second) >= separation(second, first);
}

FaceManifold meet_face(const PlacedFace& reference, const PlacedFace& other, double margin,
                       double flat_crossing) {
  const Vector3d& normal = reference.normal;
  Vector3d x = reference.corner[1] - reference.corner[0];
  x = (x - normal.dot(x) * normal).normalized();
  const Vector3d y = normal.cross(x);
  const auto in_frame = [&](const Vector3d& point) {
    const Vector3d arm = point - reference.origin;
    return Vector3d(x.dot(arm), y.dot(arm), normal.dot(arm));
  };
  Polygon polygon;
  for (int i = 0; i < other.count; ++i) polygon.add(in_frame(other.corner[i]), false);
  double radius = 0.0;
  Vector3d end = in_frame(reference.corner[0]);
  for (int i = reference.count - 1; i >= 0; --i) {
    const Vector3d begin = in_frame(reference.corner[i]);
    clip(begin, end, polygon);
    radius = std::max(radius, begin.head<2>().norm());
    end = begin;
  }
  const int crossed = polygon.count;
  if (flat_crossing > 0.0) drop_flat_crossings(flat_crossing * radius, polygon);

  FaceManifold manifold;
  manifold.normal = normal;
  manifold.dropped = crossed - polygon.count;
  for (int i = 0; i < polygon.count; ++i) {
    const Vector3d& corner = polygon.corner[i];
    if (corner.z() > margin) continue;
    const Vector3d& before = polygon.corner[i > 0 ? i - 1 : polygon.count - 1];
    if (polygon.count > 1 && (corner - before).head<2>().norm() < kSameCorner * radius) continue;
    FacePoint& point = manifold.point[manifold.count++];
    point.distance = corner.z();
    point.position = reference.origin + corner.x() * x + corner.y() * y + 0.5 * corner.z() * normal;
  }
  return manifold;
}

FaceManifold meet_plane(const Vector3d& origin, const Vector3d& normal, const PlacedFace& face,
                        double margin) {
  FaceManifold manifold;
  manifold.normal = normal;
  for (int i = 0; i < face.count; ++i) {
    const double distance = normal.dot(face.corner[i] - origin);
    if (distance > margin) continue;
    FacePoint& point = manifold.point[manifold.count++];
    point.distance = distance;
    point.position = face.corner[i] - 0.5 * distance * normal;
  }
  return manifold;
}

}  // namespace dashpot
