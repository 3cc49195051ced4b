// Times of impact along parabolas, as those of what falls.

#include <Eigen/Geometry>
#include <algorithm>
#include <random>
#include <stdexcept>
#include <vector>

#include "checks.hpp"
#include "dashpot/geometry/query.hpp"

namespace {

using namespace dashpot;
using Eigen::Vector3d;

constexpr double kHorizon = 1.0;
std::mt19937 generator(5);

double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}

Vector3d uniform_vector(double most) {
  return {uniform(-most, most), uniform(-most, most), uniform(-most, most)};
}

Shape ball(double radius) {
  Shape shape;
  shape.type = ShapeType::kSphere;
  shape.size << radius, 0.0, 0.0;
  return shape;
}

Shape box(double x, double y, double z) {
  Shape shape;
  shape.type = ShapeType::kBox;
  shape.size << x, y, z;
  return shape;
}

// A ball falls freely from rest onto another.
void check_free_fall() {
  const double gravity = 9.81, height = 0.3;
  Pose above;
  above.position.z() = 0.3 + height;
  Motion fall;
  fall.centre = above.position;
  fall.acceleration.z() = -gravity;
  const auto impact = time_of_impact(ball(0.2), {}, {}, ball(0.1), above, fall, kHorizon);
  check(impact.hit, "what falls meets what is below it");
  check_close(impact.time, std::sqrt(2.0 * height / gravity), 1.0, 1e-8,
              "it takes the time of free fall");
}

// A ball is thrown up beneath another one, and turns back where its speed is spent.
void check_turning_back() {
  const double gravity = 9.81, height = 0.2;
  for (const double missing : {-1e-6, 1e-6}) {
    Pose below;
    below.position.z() = -(0.3 + height);
    Motion thrown;
    thrown.centre = below.position;
    thrown.linear.z() = std::sqrt(2.0 * gravity * (height - missing));
    thrown.acceleration.z() = -gravity;
    const auto impact = time_of_impact(ball(0.2), {}, {}, ball(0.1), below, thrown, kHorizon);
    check(impact.hit == (missing < 0.0), "what is thrown up meets what it reaches, and only that");
  }
}

// Boxes that turn, of which both are thrown.
void check_tumbling_boxes() {
  int met = 0, passed = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Shape shape[2] = {box(0.1, 0.2, 0.3), box(0.2, 0.1, 0.15)};
    Pose pose[2];
    Motion motion[2];
    pose[1].position = Vector3d(1.0, 0.0, 0.0) + uniform_vector(0.4);
    for (int side = 0; side < 2; ++side) {
      motion[side].centre = pose[side].position;
      motion[side].linear = uniform_vector(1.0);
      motion[side].angular = uniform_vector(3.0);
      motion[side].acceleration = uniform_vector(5.0);
    }
    motion[1].linear.x() -= 2.0;
    const auto distance_at = [&](double time) {
      return distance(shape[0], advance(pose[0], motion[0], time), shape[1],
                      advance(pose[1], motion[1], time))
          .distance;
    };
    if (distance_at(0.0) <= 0.0) continue;
    const auto impact =
        time_of_impact(shape[0], pose[0], motion[0], shape[1], pose[1], motion[1], kHorizon);
    (impact.hit ? met : passed)++;
    check(!impact.hit || distance_at(impact.time) < 1e-8, "boxes meet where they are");
    double least = 1.0;
    for (int i = 0; i <= 1000; ++i) least = std::min(least, distance_at(1e-3 * i * impact.time));
    check(least > -1e-12, "boxes do not overlap before they meet");
  }
  check(met > 20 && passed > 20, "some of the boxes meet, and some pass");
}

void check_height_field() {
  std::vector<float> heights(4, 0.0f);
  Shape field;
  field.type = ShapeType::kHeightField;
  field.field.rows = field.field.columns = 2;
  field.field.half_x = field.field.half_y = field.field.elevation = field.field.base = 1.0;
  field.field.heights = heights.data();
  Pose above;
  above.position.z() = 1.0;
  Motion fall;
  fall.acceleration.z() = -9.81;
  bool refused = false;
  try {
    time_of_impact(ball(0.1), above, fall, field, {}, {}, kHorizon);
  } catch (const std::invalid_argument&) {
    refused = true;
  }
  check(refused, "parabolas onto a height field are refused");
}

}  // namespace

int main() {
  check_free_fall();
  check_turning_back();
  check_tumbling_boxes();
  check_height_field();
  return exit_status();
}
