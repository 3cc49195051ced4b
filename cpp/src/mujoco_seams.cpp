#include "dashpot/mujoco_seams.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_host.hpp"

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

double sign_of(double x) { return x < 0.0 ? -1.0 : 1.0; }

// The point (world) of a geom that is farthest along a direction. False for geoms without a bound
// and those without such a function.
bool find_support(const mjModel* m, const mjData* d, int geom, const mjtNum* direction,
                  mjtNum* point) {
  const mjtNum* size = m->geom_size + 3 * geom;
  mjtNum local[3], at[3] = {0, 0, 0};
  mju_mulMatTVec3(local, d->geom_xmat + 9 * geom, direction);
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
      mju_scl3(at, local, size[0]);
      break;
    case mjGEOM_CAPSULE:
      mju_scl3(at, local, size[0]);
      at[2] += size[1] * sign_of(local[2]);
      break;
    case mjGEOM_CYLINDER: {
      const double across = std::hypot(local[0], local[1]);
      for (int i = 0; i < 2 && across > 0.0; ++i) at[i] = size[0] * local[i] / across;
      at[2] = size[1] * sign_of(local[2]);
      break;
    }
    case mjGEOM_ELLIPSOID: {
      const double norm = std::hypot(size[0] * local[0], size[1] * local[1], size[2] * local[2]);
      for (int i = 0; i < 3; ++i) at[i] = size[i] * size[i] * local[i] / norm;
      break;
    }
    case mjGEOM_BOX:
      for (int i = 0; i < 3; ++i) at[i] = size[i] * sign_of(local[i]);
      break;
    case mjGEOM_MESH: {
      const int mesh = m->geom_dataid[geom];
      const float* vertex = m->mesh_vert + 3 * m->mesh_vertadr[mesh];
      double most = -mjMAXVAL;
      for (int i = 0; i < m->mesh_vertnum[mesh]; ++i, vertex += 3) {
        const double way = local[0] * vertex[0] + local[1] * vertex[1] + local[2] * vertex[2];
        if (way <= most) continue;
        most = way;
        std::copy_n(vertex, 3, at);
      }
      break;
    }
    default:
      return false;
  }
  mju_mulMatVec3(point, d->geom_xmat + 9 * geom, at);
  mju_addTo3(point, d->geom_xpos + 3 * geom);
  return true;
}

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
  Seams(const mjModel* m, const mjData* d, SeamBuffers& buffers,
        const std::vector<ContactInput>& contacts)
      : m_(m), d_(d), buffers_(buffers), contacts_(contacts) {
    buffers.first.assign(m->nbody, -1);
    buffers.next.resize(2 * contacts.size());
    for (size_t i = 0; i < contacts.size(); ++i)
      for (int side = 0; side < 2; ++side)
        if (!contacts[i].is_of_flex() && contacts[i].gap <= tolerance(contacts[i])) {
          int& first = buffers.first[m->geom_bodyid[contacts[i].geom[side]]];
          buffers.next[2 * i + side] = first;
          first = static_cast<int>(2 * i + side);
        }
  }

  double tolerance(const ContactInput& contact) const {
    const double radius = contact_radius(m_, contact);
    return std::isinf(radius) ? 0.0 : kTolerance * radius;
  }

  bool is_at_seam(const ContactInput& contact) const {
    const double way = -m_->opt.timestep * contact_velocity(m_, d_, contact)[0];
    if (way <= std::max(contact.gap, kMotion * contact_radius(m_, contact))) return false;
    for (int side = 0; side < 2; ++side) {
      const int body = m_->geom_bodyid[contact.geom[side]];
      for (int at = buffers_.first[body]; at >= 0; at = buffers_.next[at])
        if (passes(contact, side, contacts_[at / 2], at % 2)) return true;
    }
    return false;
  }

 private:
  // Whether the geom on `side` passes over the other one, its body resting on what is across
  // `rest_side` of `rest`.
  bool passes(const ContactInput& contact, int side, const ContactInput& rest,
              int rest_side) const {
    const int geom = contact.geom[side], other = contact.geom[1 - side];
    if (rest.geom[1 - rest_side] == other) return false;
    mjtNum up[3], down[3];  // m and -m
    mju_scl3(up, rest.frame.data(), rest_side ? 1.0 : -1.0);
    mju_scl3(down, up, -1.0);
    if ((side ? 1.0 : -1.0) * mju_dot3(contact.frame.data(), up) > kSameNormal) return false;
    const double allowed = kDepths * std::max(0.0, -rest.gap) + tolerance(contact);
    if (-contact.gap > allowed) return false;
    // Most pairs overlap by more, as their centres tell.
    mjtNum between[3];
    mju_sub3(between, d_->geom_xpos + 3 * other, d_->geom_xpos + 3 * geom);
    const double least = mju_dot3(up, between) + inner_radius(m_, other) + inner_radius(m_, geom);
    if (least > allowed) return false;
    mjtNum highest[3], lowest[3], of_other[3], own[3];
    if (!find_support(m_, d_, other, up, highest) || !find_support(m_, d_, geom, down, lowest))
      return false;
    point_velocity(m_, d_, m_->geom_bodyid[other], highest, of_other);
    point_velocity(m_, d_, m_->geom_bodyid[geom], lowest, own);
    const double overlap = mju_dot3(up, highest) - mju_dot3(up, lowest);
    const double rate = mju_dot3(up, of_other) - mju_dot3(up, own);
    return overlap + m_->opt.timestep * std::max(0.0, rate) <= allowed;
  }

  const mjModel* m_;
  const mjData* d_;
  const SeamBuffers& buffers_;
  const std::vector<ContactInput>& contacts_;
};

}  // namespace

void drop_contacts_at_seams(const mjModel_* m, const mjData_* d,
                            const std::vector<double>& start_reach, SeamBuffers& buffers,
                            std::vector<ContactInput>& contacts) {
  const auto moves = [&](const ContactInput& c) {
    return !c.is_of_flex() && start_reach[c.geom[0]] + start_reach[c.geom[1]] >
                                  std::max(c.gap, kMotion * contact_radius(m, c));
  };
  if (std::none_of(contacts.begin(), contacts.end(), moves)) return;
  const Seams seams(m, d, buffers, contacts);
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
