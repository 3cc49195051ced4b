#include "ellipsoid_contacts.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

#include "dashpot/detect/geometry_host.hpp"
#include "geom_on_terrain.hpp"

namespace dashpot::host {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Newton's steps double the digits: four are enough from 0.1 rad.
constexpr int kMostSteps = 12;
constexpr double kStill = 1e-13;  // rad, a step that changes nothing but the last digits

// S of an ellipsoid.
Matrix3d square_of(const Vector3d& half, const Pose& pose) {
  const Matrix3d axes = pose.rotation * half.asDiagonal();
  return axes * axes.transpose();
}

// What an ellipsoid has along a direction: its reach h, grad h and H.
struct Reach {
  double h;
  Vector3d point;
  Matrix3d curvature;

  Reach(const Matrix3d& square, const Vector3d& n)
      : h(std::sqrt(n.dot(square * n))),
        point(square * n / h),
        curvature((square - point * point.transpose()) / h) {}
};

// Normal from the first to the second, and the point of the first; lengths in m.
struct EllipsoidContact {
  Vector3d normal = Vector3d::Zero();
  Vector3d point = Vector3d::Zero();
  double distance = 0.0;
};

// Two ellipsoids of half-axes `half` (m, > 0) in their poses.
struct EllipsoidPair {
  Vector3d half1, half2;
  Pose pose1, pose2;
};

// Improves a normal that is about right. False, and `contact` unchanged, where Newton's steps do
// not end: nearly concentric ones have no normal.
bool find_contact(const EllipsoidPair& pair, const Vector3d& normal, EllipsoidContact& contact) {
  const Matrix3d square1 = square_of(pair.half1, pair.pose1);
  const Matrix3d square2 = square_of(pair.half2, pair.pose2);
  const Vector3d centres = pair.pose2.position - pair.pose1.position;
  Vector3d n = normal.normalized();
  for (int step = 0; step < kMostSteps; ++step) {
    const Reach first(square1, n), second(square2, n);
    const Vector3d between = centres - first.point - second.point;
    const double distance = n.dot(between);
    const Vector3d across = between - distance * n;
    Eigen::Matrix<double, 3, 2> plane;
    plane.col(0) = n.unitOrthogonal();
    plane.col(1) = n.cross(plane.col(0));
    Eigen::Matrix2d slope = plane.transpose() * (first.curvature + second.curvature) * plane;
    slope.diagonal().array() += distance;
    const Eigen::LLT<Eigen::Matrix2d> factor(slope);
    if (factor.info() != Eigen::Success) return false;
    const Vector3d turn = plane * factor.solve(plane.transpose() * across);
    if (turn.norm() <= kStill) {
      contact = {n, pair.pose1.position + first.point, distance};
      return true;
    }
    n = (n + turn).normalized();
  }
  return false;
}

// Cosine of the angle to the normal found beyond which ellipsoids have met elsewhere.
constexpr double kMetElsewhere = 0.9;
// Cosine between the normals of a face and of a contact that a search found on it.
constexpr double kFoundOnFace = 0.99999;

Vector3d size_of(const mjModel* m, int geom) { return Vector3d(m->geom_size + 3 * geom); }

// `normal` from the ellipsoid to the other geom.
void write(const Vector3d& normal, const Vector3d& point, double distance, mjPreContact& contact) {
  contact.dist = distance;
  Eigen::Map<Vector3d>(contact.normal) = normal;
  Eigen::Map<Vector3d>(contact.pos) = point + 0.5 * distance * normal;
}

void meet_ellipsoid(const mjModel* m, const mjData* d, int geom1, int geom2,
                    mjPreContact& contact) {
  const EllipsoidPair pair{size_of(m, geom1), size_of(m, geom2), unchecked_geom_pose(d, geom1),
                           unchecked_geom_pose(d, geom2)};
  const Vector3d found(contact.normal);
  EllipsoidContact nearest;
  if (find_contact(pair, found, nearest) && nearest.normal.dot(found) > kMetElsewhere)
    write(nearest.normal, nearest.point, nearest.distance, contact);
}

// A face of a box, or a flat end of a cylinder, across the axis `axis` of its frame.
void meet_face(const mjModel* m, const mjData* d, int ellipsoid, int other, int axis,
               mjPreContact& contact) {
  const Pose pose = unchecked_geom_pose(d, ellipsoid), frame = unchecked_geom_pose(d, other);
  const Vector3d size = size_of(m, other);
  const Vector3d across = frame.rotation.col(axis);
  const double cosine = -across.dot(Vector3d(contact.normal));
  if (std::abs(cosine) < kFoundOnFace) return;
  const Vector3d outward = std::copysign(1.0, cosine) * across;
  const Vector3d lowest = RoundSurfaces(m, ellipsoid).lowest(0, pose)(outward);
  const Vector3d local = frame.rotation.transpose() * (lowest - frame.position);
  const bool is_box = m->geom_type[other] == mjGEOM_BOX;
  const double half = is_box ? size[axis] : size[1];
  const int beside1 = (axis + 1) % 3, beside2 = (axis + 2) % 3;
  const bool over_face = is_box ? std::abs(local[beside1]) <= size[beside1] &&
                                      std::abs(local[beside2]) <= size[beside2]
                                : std::hypot(local[beside1], local[beside2]) <= size[0];
  if (over_face) write(-outward, lowest, outward.dot(lowest - frame.position) - half, contact);
}

}  // namespace

void improve_ellipsoid_contact(const mjModel_* m, const mjData_* d, int ellipsoid, int other,
                               mjPreContact_& contact) {
  switch (m->geom_type[other]) {
    case mjGEOM_ELLIPSOID:
      return meet_ellipsoid(m, d, ellipsoid, other, contact);
    case mjGEOM_CYLINDER:
      return meet_face(m, d, ellipsoid, other, 2, contact);
    case mjGEOM_BOX: {
      int axis = 0;
      const Pose frame = unchecked_geom_pose(d, other);
      (frame.rotation.transpose() * Vector3d(contact.normal)).cwiseAbs().maxCoeff(&axis);
      return meet_face(m, d, ellipsoid, other, axis, contact);
    }
    default:
      return;
  }
}

}  // namespace dashpot::host
