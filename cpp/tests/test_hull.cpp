// Support points of hulls, and bounds on distances, against all corners and the distances
// themselves.

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "checks.hpp"
#include "dashpot/geometry/hull.hpp"
#include "dashpot/geometry/query.hpp"

namespace {

using namespace dashpot;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

std::mt19937 generator(5);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
Vector3d random_vector() { return {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)}; }

Matrix3Xd random_corners(int count) {
  Matrix3Xd corners(3, count);
  for (int i = 0; i < count; ++i) corners.col(i) = random_vector();
  return corners;
}

void test_furthest_corner() {
  for (int count = 1; count < 40; ++count) {
    const Matrix3Xd corners = random_corners(count);
    const Hull hull(corners);
    check(hull.count() == count && hull.is_finite(), "a hull has its corners");
    check(hull.extent() == corners.colwise().norm().maxCoeff(), "its extent is the farthest's");
    for (int i = 0; i < 20; ++i) {
      const Vector3d direction = random_vector();
      const double expected = (direction.transpose() * corners).maxCoeff();
      const double found = hull.furthest_along(direction).dot(direction);
      check(std::abs(found - expected) < 1e-15, "no corner is further along a direction");
    }
  }
}

void test_first_of_equals() {
  Matrix3Xd corners(3, 7);
  for (int i = 0; i < 7; ++i) corners.col(i) = Vector3d(i == 2 || i == 5, i, 0.0);
  check(Hull(corners).furthest_along(Vector3d::UnitX()).y() == 2.0, "the first of several");
}

void test_fewer_corners_than_before() {
  Hull hull(random_corners(30));
  const Matrix3Xd fewer = random_corners(5);
  hull.set(fewer);
  const Vector3d direction = random_vector();
  check(hull.furthest_along(direction).dot(direction) <=
            (direction.transpose() * fewer).maxCoeff() + 1e-15,
        "corners of before are gone");
}

Shape random_shape() {
  Shape shape;
  constexpr ShapeType kTypes[] = {ShapeType::kSphere,    ShapeType::kCapsule, ShapeType::kCylinder,
                                  ShapeType::kEllipsoid, ShapeType::kBox,     ShapeType::kHull};
  shape.type = kTypes[generator() % 6];
  shape.size = Vector3d(uniform(0.1, 0.5), uniform(0.1, 0.5), uniform(0.1, 0.5));
  if (shape.type == ShapeType::kHull)
    shape.hull = std::make_shared<const Hull>(0.5 * random_corners(20));
  return shape;
}

Pose random_pose() {
  Pose pose;
  pose.position = random_vector();
  pose.rotation = Eigen::AngleAxisd(uniform(0, 3), random_vector().normalized()).toRotationMatrix();
  return pose;
}

void test_bounds_on_the_distance() {
  int apart = 0;
  for (int i = 0; i < 2000; ++i) {
    const Shape shape1 = random_shape(), shape2 = random_shape();
    const Pose pose1 = random_pose(), pose2 = random_pose();
    const Distance exact = distance(shape1, pose1, shape2, pose2);
    const Vector3d any = random_vector().normalized();
    check(gap_along(shape1, pose1, shape2, pose2, any) < exact.distance + 1e-9,
          "a gap along any direction is no more than the distance");
    check(std::abs(gap_along(shape1, pose1, shape2, pose2, exact.normal) - exact.distance) < 1e-8,
          "along the normal it is the distance");
    for (double less : {0.01, 0.3})
      if (exact.distance > less) {
        check(are_farther_apart(shape1, pose1, shape2, pose2, exact.distance - less),
              "they are farther apart than less than their distance");
        ++apart;
      }
    check(!are_farther_apart(shape1, pose1, shape2, pose2, std::max(0.0, exact.distance) + 1e-7),
          "they are not farther apart than more than their distance");
  }
  check(apart > 500, "enough of them are apart");
}

}  // namespace

int main() {
  test_furthest_corner();
  test_first_of_equals();
  test_fewer_corners_than_before();
  test_bounds_on_the_distance();
  return exit_status();
}
