#include "dashpot/geometry/ellipsoids.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

namespace dashpot {

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

}  // namespace

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

}  // namespace dashpot
