// The triangles of a height field's surface: which lies beneath a point, what lies across an edge,
// and how the surface bends there.

#include <cmath>
#include <random>
#include <vector>

#include "checks.hpp"
#include "dashpot/geometry/terrain.hpp"

namespace {

using namespace dashpot;
using Eigen::Vector3d;

constexpr int kRows = 7, kColumns = 5;
constexpr double kHalfX = 0.8, kHalfY = 1.2, kElevation = 0.3;

HeightField field_of(const std::vector<float>& heights) {
  HeightField field;
  field.rows = kRows;
  field.columns = kColumns;
  field.half_x = kHalfX;
  field.half_y = kHalfY;
  field.elevation = kElevation;
  field.base = 0.1;
  field.heights = heights.data();
  return field;
}

std::vector<float> heights_of(double (*height)(double x, double y)) {
  std::vector<float> heights;
  for (int row = 0; row < kRows; ++row)
    for (int column = 0; column < kColumns; ++column)
      heights.push_back(static_cast<float>(height(2.0 * kHalfX * column / (kColumns - 1) - kHalfX,
                                                  2.0 * kHalfY * row / (kRows - 1) - kHalfY)));
  return heights;
}

std::mt19937 generator(3);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}

int shared_corners(const TerrainTriangle& a, const TerrainTriangle& b) {
  int count = 0;
  for (const Vector3d& p : a.corner)
    for (const Vector3d& q : b.corner) count += (p - q).norm() < 1e-12;
  return count;
}

void test_triangle_beneath_a_point() {
  const std::vector<float> heights = heights_of([](double, double) { return uniform(0.0, 1.0); });
  const HeightField field = field_of(heights);
  const Terrain terrain(field);
  for (int i = 0; i < 1000; ++i) {
    const Vector3d point(uniform(-kHalfX, kHalfX), uniform(-kHalfY, kHalfY), uniform(-1.0, 1.0));
    const auto triangle = terrain.beneath(point);
    check(triangle.has_value(), "a triangle beneath every point of the field");
    // Barycentric coordinates, seen from above.
    const auto area = [](const Vector3d& a, const Vector3d& b, const Vector3d& c) {
      return (b - a).head<2>().x() * (c - a).y() - (b - a).y() * (c - a).x();
    };
    const auto& [a, b, c] = triangle->corner;
    const double whole = area(a, b, c);
    for (double part : {area(point, b, c), area(a, point, c), area(a, b, point)})
      check(part / whole > -1e-12, "the point lies over its triangle");
    check(triangle->normal.z() > 0.0, "normals point up");
    for (const Vector3d& corner : triangle->corner)
      check(std::abs(triangle->height_of(corner)) < 1e-12, "corners lie in the plane");
    check(terrain.highest_about(point, 0.0) >= std::max({a.z(), b.z(), c.z()}) - 1e-12,
          "no corner beneath is higher than the highest about");
  }
  for (const Vector3d& point : {Vector3d(-kHalfX - 1e-9, 0, 0), Vector3d(kHalfX + 1e-9, 0, 0),
                                Vector3d(0, -kHalfY - 1e-9, 0), Vector3d(0, kHalfY + 1e-9, 0)})
    check(!terrain.beneath(point), "nothing beneath a point beyond the rim");
}

void test_triangle_across_an_edge() {
  const std::vector<float> heights = heights_of([](double, double) { return uniform(0.0, 1.0); });
  const HeightField field = field_of(heights);
  const Terrain terrain(field);
  int rims = 0;
  for (int i = 0; i < 300; ++i) {
    const auto triangle =
        terrain.beneath(Vector3d(uniform(-kHalfX, kHalfX), uniform(-kHalfY, kHalfY), 0.0));
    for (int edge = 0; edge < 3; ++edge) {
      const auto other = terrain.across(*triangle, edge);
      const Vector3d &begin = triangle->corner[edge], &end = triangle->corner[(edge + 1) % 3];
      if (!other) {
        ++rims;
        const bool at_rim =
            (std::abs(begin.x()) == kHalfX && begin.x() == end.x()) ||
            (std::abs(std::abs(begin.y()) - kHalfY) < 1e-12 && begin.y() == end.y());
        check(at_rim, "nothing across an edge only at the rim");
        check(terrain.bend(*triangle, edge) == -1.0, "the rim stands out");
        continue;
      }
      check(shared_corners(*triangle, *other) == 2, "both share the edge");
      check(other->distance_to(edge, begin) >= 0.0, "distances are not negative");
      check(triangle->distance_to(edge, 0.5 * (begin + end)) < 1e-12, "an edge is no way from it");
      // The corner that they do not share: above the plane where the surface rises across the edge.
      double height = 0.0;
      for (const Vector3d& corner : other->corner)
        if (std::abs(triangle->height_of(corner)) > std::abs(height))
          height = triangle->height_of(corner);
      const double bend = terrain.bend(*triangle, edge);
      check(height * bend > 0.0, "the surface rises where it is hollow");
      const double angle = std::acos(std::min(1.0, triangle->normal.dot(other->normal)));
      check(std::abs(std::abs(bend) - std::sin(angle)) < 1e-7, "by the angle between both normals");
    }
  }
  check(rims > 0, "some edges lie at the rim");
}

void test_flat_about() {
  const std::vector<float> ramp = heights_of([](double x, double y) { return 0.4 * x - 0.3 * y; });
  const HeightField ramp_field = field_of(ramp);
  const Terrain flat(ramp_field);
  const std::vector<float> roof = heights_of([](double x, double) { return -std::abs(x); });
  const HeightField roof_field = field_of(roof);
  const Terrain ridge(roof_field);
  for (int i = 0; i < 200; ++i) {
    const Vector3d point(uniform(-0.3, 0.3), uniform(-0.7, 0.7), 0.0);
    const auto on_ramp = flat.beneath(point), on_roof = ridge.beneath(point);
    const auto on_surface = [&](const TerrainTriangle& t) -> Vector3d {
      return point - Vector3d(0, 0, t.height_of(point) / t.normal.z());
    };
    check(flat.is_flat_about(*on_ramp, on_surface(*on_ramp), 0.05), "a ramp is flat");
    const Vector3d foot = on_surface(*on_roof);
    const double to_ridge = std::hypot(foot.x(), kElevation * foot.x());
    if (std::abs(to_ridge - 0.05) > 1e-3)
      check(ridge.is_flat_about(*on_roof, foot, 0.05) == (to_ridge > 0.05),
            "a roof is flat but near its ridge");
  }
}

}  // namespace

int main() {
  test_triangle_beneath_a_point();
  test_triangle_across_an_edge();
  test_flat_about();
  return exit_status();
}
