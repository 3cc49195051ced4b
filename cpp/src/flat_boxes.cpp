#include "dashpot/flat_boxes.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Cosine of the tilt up to which MuJoCo, too, lets a face stand for the axis across two edges, if
// both overlap by about the same.
constexpr double kFlatCosine = 0.99;
// Part of the reference face's half-diagonal within which corners that clipping made are one.
constexpr double kSameCorner = 1e-7;

struct Face {
  const PlacedBox* box = nullptr;
  int axis = 0;
  double sign = 1.0;
  Vector3d normal() const { return sign * box->pose.rotation.col(axis); }
};

// The face of a box that looks along `direction`.
Face face_along(const PlacedBox& box, const Vector3d& direction) {
  const Vector3d local = box.pose.rotation.transpose() * direction;
  Face face{&box};
  local.cwiseAbs().maxCoeff(&face.axis);
  face.sign = local[face.axis] < 0.0 ? -1.0 : 1.0;
  return face;
}

// How far a face separates its box from another one (m): the height of the other's lowest corner.
double separation(const Face& face, const PlacedBox& other) {
  const Vector3d normal = face.normal();
  const double reach = (other.pose.rotation.transpose() * normal).cwiseAbs().dot(other.half);
  return normal.dot(other.pose.position - face.box->pose.position) - face.box->half[face.axis] -
         reach;
}

// Corners in a plane, in order, and their height over it.
struct Polygon {
  std::array<Vector3d, 8> corner;
  int count = 0;
  void add(const Vector3d& point) {
    if (count < static_cast<int>(corner.size())) corner[count++] = point;
  }
};

// What of a polygon lies where sign * coordinate <= limit (Sutherland and Hodgman).
void clip(int coordinate, double sign, double limit, Polygon& polygon) {
  const auto beyond = [&](const Vector3d& p) { return sign * p[coordinate] - limit; };
  const Polygon in = polygon;
  polygon.count = 0;
  for (int i = 0; i < in.count; ++i) {
    const Vector3d &p = in.corner[i], &q = in.corner[i + 1 < in.count ? i + 1 : 0];
    const double at_p = beyond(p), at_q = beyond(q);
    if (at_p <= 0.0) polygon.add(p);
    if (at_p * at_q < 0.0) polygon.add(p + at_p / (at_p - at_q) * (q - p));
  }
}

// The corners of `face` in the frame of `reference`: along the two other axes of its box, and the
// height over it.
Polygon corners_over(const Face& reference, const Face& face) {
  const Pose &base = reference.box->pose, &pose = face.box->pose;
  const int x = (reference.axis + 1) % 3, y = (reference.axis + 2) % 3;
  const int u = (face.axis + 1) % 3, v = (face.axis + 2) % 3;
  const auto in_frame = [&](const Vector3d& world) {
    const Vector3d local = base.rotation.transpose() * world;
    return Vector3d(local[x], local[y], reference.sign * local[reference.axis]);
  };
  const Vector3d to_centre =
      in_frame(pose.position - base.position + face.box->half[face.axis] * face.normal()) -
      Vector3d(0.0, 0.0, reference.box->half[reference.axis]);
  const Vector3d along_u = in_frame(face.box->half[u] * pose.rotation.col(u));
  const Vector3d along_v = in_frame(face.box->half[v] * pose.rotation.col(v));
  Polygon polygon;
  polygon.add(to_centre + along_u + along_v);
  polygon.add(to_centre - along_u + along_v);
  polygon.add(to_centre - along_u - along_v);
  polygon.add(to_centre + along_u - along_v);
  return polygon;
}

}  // namespace

FaceManifold meet_flat(const PlacedBox& first, const PlacedBox& second, const Vector3d& direction,
                       double margin) {
  FaceManifold manifold;
  const Face faces[2] = {face_along(first, direction), face_along(second, -direction)};
  if (faces[0].normal().dot(direction) < kFlatCosine ||
      faces[1].normal().dot(direction) > -kFlatCosine)
    return manifold;
  const int side = separation(faces[0], second) >= separation(faces[1], first) ? 0 : 1;
  const Face& reference = faces[side];
  const int x = (reference.axis + 1) % 3, y = (reference.axis + 2) % 3;
  const Vector3d& half = reference.box->half;
  Polygon polygon = corners_over(reference, faces[1 - side]);
  clip(0, 1.0, half[x], polygon);
  clip(0, -1.0, half[x], polygon);
  clip(1, 1.0, half[y], polygon);
  clip(1, -1.0, half[y], polygon);

  manifold.normal = side == 0 ? reference.normal() : Vector3d(-reference.normal());
  const Pose& pose = reference.box->pose;
  const double same = kSameCorner * std::hypot(half[x], half[y]);
  for (int i = 0; i < polygon.count; ++i) {
    const Vector3d& corner = polygon.corner[i];
    if (corner.z() > margin) continue;
    const Vector3d& before = polygon.corner[i > 0 ? i - 1 : polygon.count - 1];
    if (polygon.count > 1 && (corner - before).head<2>().norm() < same) continue;
    FacePoint& point = manifold.point[manifold.count++];
    point.distance = corner.z();
    point.position = pose.position + corner.x() * pose.rotation.col(x) +
                     corner.y() * pose.rotation.col(y) +
                     (half[reference.axis] + 0.5 * corner.z()) * reference.normal();
  }
  return manifold;
}

}  // namespace dashpot
