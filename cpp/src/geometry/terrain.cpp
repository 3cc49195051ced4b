#include "dashpot/geometry/terrain.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <utility>

#include "prisms.hpp"

namespace dashpot {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

namespace {

// Sine of the angle by which the normals of contacts that MuJoCo searches for may be off.
constexpr double kRise = 5e-3;

// rad, between sides of a groove that each bear their part.
constexpr double kMostBend = 0.3;

}  // namespace

double TerrainTriangle::distance_to(int edge, const Vector3d& point) const {
  const Vector3d along = (corner[(edge + 1) % 3] - corner[edge]).normalized();
  return (point - corner[edge]).cross(along).norm();
}

Terrain::Terrain(const HeightField& field) : field_(field), grid_(field) {}

TerrainTriangle Terrain::at(int row, int column, int half) const {
  TerrainTriangle triangle{row, column, half, {}, {}};
  const auto corners = HeightFieldGrid::corners(row, column, half);
  for (int i = 0; i < 3; ++i) triangle.corner[i] = grid_.corner(corners[i][0], corners[i][1]);
  triangle.normal = (triangle.corner[1] - triangle.corner[0])
                        .cross(triangle.corner[2] - triangle.corner[0])
                        .normalized();
  if (triangle.normal.z() < 0.0) triangle.normal = -triangle.normal;
  return triangle;
}

std::optional<TerrainTriangle> Terrain::beneath(const Vector3d& point) const {
  const double x = grid_.column_at(point.x()), y = grid_.row_at(point.y());
  const double column = std::floor(x), row = std::floor(y);
  if (!(column >= 0.0 && row >= 0.0 && column < grid_.columns() && row < grid_.rows()))
    return std::nullopt;
  return at(static_cast<int>(row), static_cast<int>(column), y - row > x - column ? 1 : 0);
}

Vector3d Terrain::normal_beneath(const Vector3d& point) const {
  const auto triangle = beneath(point);
  return triangle ? triangle->normal : Vector3d::UnitZ();
}

std::optional<TerrainTriangle> Terrain::across(const TerrainTriangle& triangle, int edge) const {
  int row = triangle.row, column = triangle.column;
  // Edge 0 is the diagonal, edge 1 ends at the high corner, edge 2 at the low one.
  const int step = edge == 1 ? 1 : edge == 2 ? -1 : 0;
  // Those of the half below the diagonal: the far side along x, the near one along y.
  int& beyond = (triangle.half == 0) == (edge == 1) ? column : row;
  beyond += step;
  if (row < 0 || column < 0 || row >= grid_.rows() || column >= grid_.columns())
    return std::nullopt;
  return at(row, column, 1 - triangle.half);
}

double Terrain::bend(const TerrainTriangle& triangle, int edge) const {
  const std::optional<TerrainTriangle> other = across(triangle, edge);
  if (!other) return -1.0;
  const Vector3d along = (triangle.corner[(edge + 1) % 3] - triangle.corner[edge]).normalized();
  const double sine = triangle.normal.cross(other->normal).dot(along);
  // Seen from above corners of the one half go clockwise, of the other counterclockwise.
  return triangle.half == 0 ? sine : -sine;
}

Terrain::Fan Terrain::about(const TerrainTriangle& triangle, const Vector3d& point,
                            double near) const {
  Fan fan;
  fan.triangle[fan.count++] = triangle;
  for (int next = 0; next < fan.count; ++next) {
    for (int edge = 0; edge < 3; ++edge) {
      if (fan.triangle[next].distance_to(edge, point) > near) continue;
      const double sine = bend(fan.triangle[next], edge);
      fan.is_flat = fan.is_flat && std::abs(sine) <= kFlatBend;
      const std::optional<TerrainTriangle> other = across(fan.triangle[next], edge);
      if (!other) continue;
      const auto is_other = [&](const TerrainTriangle& t) { return t.is_same(*other); };
      const auto end = fan.triangle.begin() + fan.count;
      if (std::any_of(fan.triangle.begin(), end, is_other)) continue;
      if (fan.count == kAroundVertex) {
        fan.is_flat = false;
        return fan;
      }
      fan.triangle[fan.count++] = *other;
    }
  }
  return fan;
}

bool Terrain::is_flat_about(const TerrainTriangle& triangle, const Vector3d& point,
                            double near) const {
  return about(triangle, point, near).is_flat;
}

bool Terrain::leads_out(const TerrainTriangle& triangle, const Vector3d& point,
                        const Vector3d& direction, double near) const {
  const Fan fan = about(triangle, point, near);
  for (int i = 0; i < fan.count; ++i)
    for (const Vector3d& corner : fan.triangle[i].corner) {
      const Vector3d way = corner - point;
      if (direction.dot(way) > kRise * (way.norm() + near)) return false;
    }
  return true;
}

double Terrain::highest_about(const Vector3d& point, double radius) const {
  const Prisms prisms(field_);
  const Vector3d reach = Vector3d::Constant(radius);
  return prisms.box(prisms.cells(AlignedBox3d(point - reach, point + reach))).max().z();
}

bool are_in_one_place(double deepest, double apart, double turn, double approach) {
  return turn < kMostBend && apart * turn < -2.0 * (deepest + std::abs(approach));
}

void TerrainContacts::add(const TerrainContact& contact) {
  if (count_ < kRoom) {
    contact_[count_++] = contact;
    return;
  }
  const auto is_nearer = [](const TerrainContact& a, const TerrainContact& b) {
    return a.distance < b.distance;
  };
  TerrainContact& farthest = *std::max_element(contact_.begin(), contact_.end(), is_nearer);
  if (is_nearer(contact, farthest)) farthest = contact;
}

bool TerrainContacts::has(const Vector3d& position, const Vector3d& normal, double distance,
                          double place, double cosine) const {
  return std::any_of(begin(), end(), [&](const TerrainContact& c) {
    return c.distance < distance + kAsDeep * radius_ && (c.position - position).norm() < place &&
           c.normal.dot(normal) > cosine;
  });
}

bool TerrainContacts::has_on_plane(const TerrainTriangle& triangle, const Vector3d& point,
                                   int surface) const {
  const double distance = triangle.height_of(point);
  return std::any_of(begin(), end(), [&](const TerrainContact& c) {
    return c.surface == surface && c.normal.cross(triangle.normal).norm() <= kFlatBend &&
           std::abs(c.distance - distance) <= kAsDeep * radius_ &&
           (c.position - point).norm() < radius_;
  });
}

double TerrainContacts::deepest() const {
  double least = 0.0;
  for (const TerrainContact& c : *this) least = std::min(least, c.distance);
  return least;
}

void TerrainContacts::merge(const Vector3d& way) {
  const std::array<TerrainContact, kRoom> all = contact_;
  const TerrainContact* const last = all.data() + std::exchange(count_, 0);
  for (const TerrainContact* c = all.data(); c != last; ++c) {
    const auto stands_for_it = [&](const TerrainContact& deeper) {
      const Vector3d turn = deeper.normal - c->normal;
      return c->surface >= 0 && deeper.surface == c->surface && deeper.distance < c->distance &&
             are_in_one_place(deeper.distance, (deeper.position - c->position).norm(), turn.norm(),
                              turn.dot(way));
    };
    if (std::none_of(all.data(), last, stands_for_it)) contact_[count_++] = *c;
  }
}

}  // namespace dashpot
