#include "dashpot/detect/supports.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

// Fraction of the smaller geom's radius that tiles may differ by in height.
constexpr double kTolerance = 1e-4;

}  // namespace

bool rolls_on(const mjModel* m, int geom, int other) {
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
    case mjGEOM_CAPSULE:
    case mjGEOM_ELLIPSOID:
    case mjGEOM_CYLINDER:
      return m->geom_type[other] == mjGEOM_BOX || m->geom_type[other] == mjGEOM_MESH;
    default:
      return false;
  }
}

Supports::Supports(const mjModel* m, const mjData* d, const std::vector<double>& start_reach,
                   SupportBuffers& buffers, const std::vector<ContactInput>& contacts)
    : m_(m), d_(d), start_reach_(start_reach), buffers_(buffers), contacts_(contacts) {
  buffers.first.assign(m->nbody, -1);
  buffers.next.resize(2 * contacts.size());
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (!may_bear(contacts[i])) continue;
    for (int side = 0; side < 2; ++side) {
      int& first = buffers.first[body_of(contacts[i], side)];
      buffers.next[2 * i + side] = first;
      first = static_cast<int>(2 * i + side);
    }
  }
}

int Supports::body_of(const ContactInput& contact, int side) const {
  const int body = m_->geom_bodyid[contact.geom[side]], held_by = m_->body_weldid[body];
  return held_by != 0 ? held_by : body;
}

double Supports::tolerance(const ContactInput& contact) const {
  const double radius = contact_radius(m_, contact);
  return std::isinf(radius) ? 0.0 : kTolerance * radius;
}

double Supports::closing(const ContactInput& contact) const {
  return std::max(0.0, -contact_velocity(m_, d_, contact)[0]);
}

double Supports::reach(const ContactInput& contact) const {
  return start_reach_[contact.geom[0]] + start_reach_[contact.geom[1]];
}

Eigen::Vector3d Supports::support_point(int geom, const Eigen::Vector3d& direction) const {
  const Shape& shape = buffers_.shapes.of(m_, geom);
  return core_support(shape, unchecked_geom_pose(d_, geom), direction) +
         sweep_radius(shape) * direction;
}

double Supports::rate_along(int geom, const Eigen::Vector3d& direction,
                            const Eigen::Vector3d& point) const {
  Eigen::Vector3d velocity;
  point_velocity(m_, d_, m_->geom_bodyid[geom], point.data(), velocity.data());
  return direction.dot(velocity);
}

bool Supports::may_bear(const ContactInput& contact) const {
  return !contact.is_of_flex() && contact.gap <= std::max(tolerance(contact), reach(contact));
}

}  // namespace dashpot::host
