#include "dashpot/geometry/terrain_contacts.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// rad, between sides of a groove that each bear their part.
constexpr double kMostBend = 0.3;

}  // namespace

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
