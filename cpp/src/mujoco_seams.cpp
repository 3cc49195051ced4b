#include "dashpot/mujoco_seams.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_properties.hpp"
#include "dashpot/mujoco_velocities.hpp"

namespace dashpot::host {

namespace {

// Parts of the smaller geom's radius: what tiles may differ by in height, and what counts as motion
// in a step.
constexpr double kTolerance = 1e-4;
constexpr double kMotion = 1e-5;
// Depths: those of one body under its load differ by less.
constexpr double kDepths = 1.5;
// Cosine between normals that are the same.
constexpr double kSameNormal = 0.9999;

// A radius about its centre that a geom contains; 0 where none is known.
double inner_radius(const mjModel* m, int geom) {
  const mjtNum* size = m->geom_size + 3 * geom;
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
    case mjGEOM_CAPSULE:
      return size[0];
    case mjGEOM_CYLINDER:
      return std::min(size[0], size[1]);
    case mjGEOM_ELLIPSOID:
    case mjGEOM_BOX:
      return std::min({size[0], size[1], size[2]});
    default:
      return 0.0;
  }
}

class Seams {
 public:
  Seams(const mjModel* m, const mjData* d, FaceBuffers& faces, SeamBuffers& buffers,
        const std::vector<ContactInput>& contacts)
      : m_(m), d_(d), faces_(faces), buffers_(buffers), contacts_(contacts) {
    buffers.first.assign(m->nbody, -1);
    buffers.next.resize(2 * contacts.size());
    for (size_t i = 0; i < contacts.size(); ++i)
      for (int side = 0; side < 2; ++side)
        if (!contacts[i].is_of_flex() && contacts[i].gap <= tolerance(contacts[i])) {
          int& first = buffers.first[body_of(contacts[i], side)];
          buffers.next[2 * i + side] = first;
          first = static_cast<int>(2 * i + side);
        }
  }

  double tolerance(const ContactInput& contact) const {
    const double radius = contact_radius(m_, contact);
    return std::isinf(radius) ? 0.0 : kTolerance * radius;
  }

  bool is_at_seam(const ContactInput& contact) {
    const double way = -m_->opt.timestep * contact_velocity(m_, d_, contact)[0];
    if (way <= std::max(contact.gap, kMotion * contact_radius(m_, contact))) return false;
    for (int side = 0; side < 2; ++side) {
      const int body = body_of(contact, side), other = body_of(contact, 1 - side);
      // What all the world's contacts are with is not looked through for each of them: of what
      // rests on a static body, only the body of the other geom can be at a seam with itself.
      const bool is_static = m_->body_weldid[body] == 0;
      for (int at = buffers_.first[is_static ? other : body]; at >= 0; at = buffers_.next[at]) {
        const ContactInput& rest = contacts_[at / 2];
        const int rest_side = is_static ? 1 - at % 2 : at % 2;
        if (body_of(rest, rest_side) == body && passes(contact, side, rest, rest_side)) return true;
      }
    }
    return false;
  }

 private:
  int body_of(const ContactInput& contact, int side) const {
    return m_->geom_bodyid[contact.geom[side]];
  }

  // Whether the geom has a bound in every direction.
  bool is_bounded(int geom) const {
    const int type = m_->geom_type[geom];
    return type != mjGEOM_PLANE && type != mjGEOM_HFIELD && has_shape(m_, geom);
  }

  // The point (world) of a geom that is farthest along a unit direction.
  Eigen::Vector3d support(int geom, const Eigen::Vector3d& direction) {
    const Shape& shape = buffers_.shapes.of(m_, geom);
    return core_support(shape, unchecked_geom_pose(d_, geom), direction) +
           sweep_radius(shape) * direction;
  }

  // Velocity (m/s) along a direction of a geom's body at a point.
  double rate_along(int geom, const Eigen::Vector3d& direction,
                    const Eigen::Vector3d& point) const {
    Eigen::Vector3d velocity;
    point_velocity(m_, d_, m_->geom_bodyid[geom], point.data(), velocity.data());
    return direction.dot(velocity);
  }

  // Whether the geom on `side` passes over the other one, its body resting on what is across
  // `rest_side` of `rest`.
  bool passes(const ContactInput& contact, int side, const ContactInput& rest, int rest_side) {
    const int geom = contact.geom[side], other = contact.geom[1 - side];
    if (rest.geom[1 - rest_side] == other || !is_bounded(other) || !is_bounded(geom)) return false;
    const Eigen::Vector3d up =  // m
        (rest_side ? 1.0 : -1.0) * Eigen::Map<const Eigen::Vector3d>(rest.frame.data());
    const Eigen::Map<const Eigen::Vector3d> normal(contact.frame.data());
    if ((side ? 1.0 : -1.0) * normal.dot(up) > kSameNormal) return false;
    const double allowed = kDepths * std::max(0.0, -rest.gap) + tolerance(contact);
    if (-contact.gap > allowed) return false;
    // Most pairs overlap by more, as their centres tell.
    const Eigen::Vector3d between = Eigen::Map<const Eigen::Vector3d>(d_->geom_xpos + 3 * other) -
                                    Eigen::Map<const Eigen::Vector3d>(d_->geom_xpos + 3 * geom);
    if (up.dot(between) + inner_radius(m_, other) + inner_radius(m_, geom) > allowed) return false;
    if (!has_face_along(m_, d_, other, up, kSameNormal, faces_)) return false;
    const Eigen::Vector3d highest = support(other, up), lowest = support(geom, -up);
    const double overlap = up.dot(highest - lowest);
    const double rate = rate_along(other, up, highest) - rate_along(geom, up, lowest);
    return overlap + m_->opt.timestep * std::max(0.0, rate) <= allowed;
  }

  const mjModel* m_;
  const mjData* d_;
  FaceBuffers& faces_;
  SeamBuffers& buffers_;
  const std::vector<ContactInput>& contacts_;
};

}  // namespace

void drop_contacts_at_seams(const mjModel_* m, const mjData_* d,
                            const std::vector<double>& start_reach, FaceBuffers& faces,
                            SeamBuffers& buffers, std::vector<ContactInput>& contacts) {
  const auto moves = [&](const ContactInput& c) {
    return !c.is_of_flex() && start_reach[c.geom[0]] + start_reach[c.geom[1]] >
                                  std::max(c.gap, kMotion * contact_radius(m, c));
  };
  if (std::none_of(contacts.begin(), contacts.end(), moves)) return;
  Seams seams(m, d, faces, buffers, contacts);
  // Those to be dropped are found before any is: each may be what another body rests on.
  size_t kept = 0;
  std::vector<char>& at_seam = buffers.at_seam;
  at_seam.resize(contacts.size());
  for (size_t i = 0; i < contacts.size(); ++i)
    at_seam[i] = moves(contacts[i]) && seams.is_at_seam(contacts[i]);
  for (size_t i = 0; i < contacts.size(); ++i)
    if (!at_seam[i]) {
      if (kept != i) contacts[kept] = contacts[i];
      ++kept;
    }
  contacts.resize(kept);
}

}  // namespace dashpot::host
