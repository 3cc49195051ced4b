#include "dashpot/detect/broadphase.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "dashpot/detect/detection.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot::host {

namespace {

unsigned signature_of(int body1, int body2) {
  return (static_cast<unsigned>(std::min(body1, body2)) << 16) +
         static_cast<unsigned>(std::max(body1, body2));
}

bool is_excluded(const mjModel* m, int body1, int body2) {
  int* const end = m->exclude_signature + m->nexclude;
  return std::find(m->exclude_signature, end, static_cast<int>(signature_of(body1, body2))) != end;
}

bool have_common_bits(const int* contype, const int* conaffinity, int a, int b) {
  return (contype[a] & conaffinity[b]) || (contype[b] & conaffinity[a]);
}

template <typename T>
bool any_positive(const T* values, mjtSize count) {
  return std::any_of(values, values + count, [](T value) { return value > 0; });
}

bool may_have_constraints(const mjModel* m) {
  const auto enabled = [&](int flag) { return !(m->opt.disableflags & flag); };
  return (enabled(mjDSBL_EQUALITY) && m->neq > 0) ||
         (enabled(mjDSBL_LIMIT) &&
          (any_positive(m->jnt_limited, m->njnt) || any_positive(m->tendon_limited, m->ntendon))) ||
         (enabled(mjDSBL_FRICTIONLOSS) && (any_positive(m->dof_frictionloss, m->nv) ||
                                           any_positive(m->tendon_frictionloss, m->ntendon)));
}

bool may_have_contacts(const mjModel* m) {
  if (m->opt.disableflags & mjDSBL_CONTACT) return false;
  if (m->npair > 0 || m->nflex > 0) return true;
  for (int geom1 = 0; geom1 < m->ngeom; ++geom1) {
    if (!m->geom_contype[geom1] && !m->geom_conaffinity[geom1]) continue;
    for (int geom2 = geom1 + 1; geom2 < m->ngeom; ++geom2)
      if (may_meet(m, geom1, geom2)) return true;
  }
  return false;
}

// Half-widths by the size of a geom about its centre; whether its type has them.
bool half_widths_of_size(const mjModel* m, int geom, double* half) {
  const mjtNum* size = m->geom_size + 3 * geom;
  const auto set = [&](double x, double y, double z) {
    half[0] = x;
    half[1] = y;
    half[2] = z;
    return true;
  };
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
      return set(size[0], size[0], size[0]);
    case mjGEOM_CAPSULE:
      return set(size[0], size[0], size[1] + size[0]);
    case mjGEOM_CYLINDER:
      return set(size[0], size[0], size[1]);
    case mjGEOM_ELLIPSOID:
    case mjGEOM_BOX:
      return set(size[0], size[1], size[2]);
    default:
      return false;
  }
}

// Half-width (m) of a box along a unit vector of the world.
double half_width_along(const BoundingBox& box, const double* direction) {
  mjtNum along[3];
  mju_mulMatTVec3(along, box.rotation, direction);
  return box.half[0] * std::abs(along[0]) + box.half[1] * std::abs(along[1]) +
         box.half[2] * std::abs(along[2]);
}

// Fraction of the least half-width of two geoms: a tenth of what rigid contacts may sag by.
constexpr double kUnknown = 1e-4;

}  // namespace

CandidatePair pair_of(const mjModel_* m, int geom1, int geom2, int defined) {
  const unsigned bodies = signature_of(m->geom_bodyid[geom1], m->geom_bodyid[geom2]);
  if (m->geom_type[geom1] > m->geom_type[geom2]) std::swap(geom1, geom2);
  return {{geom1, geom2}, defined, bodies};
}

bool comes_before(const CandidatePair& a, const CandidatePair& b) {
  if (a.bodies != b.bodies) return a.bodies < b.bodies;
  if ((a.defined < 0) != (b.defined < 0)) return b.defined < 0;
  return std::tie(a.defined, a.geom) < std::tie(b.defined, b.geom);
}

bool may_meet(const mjModel_* m, int geom1, int geom2) {
  const int body1 = m->geom_bodyid[geom1], body2 = m->geom_bodyid[geom2];
  if (!have_common_bits(m->geom_contype, m->geom_conaffinity, geom1, geom2) ||
      !have_common_bits(m->body_contype, m->body_conaffinity, body1, body2))
    return false;
  const int weld1 = m->body_weldid[body1], weld2 = m->body_weldid[body2];
  if (m->body_treeid[body1] < 0 && m->body_treeid[body2] < 0) return false;
  if (weld1 == weld2 || is_excluded(m, body1, body2)) return false;
  if (m->opt.disableflags & mjDSBL_FILTERPARENT || weld1 == 0 || weld2 == 0) return true;
  const int parent1 = m->body_weldid[m->body_parentid[weld1]];
  const int parent2 = m->body_weldid[m->body_parentid[weld2]];
  return weld1 != parent2 && weld2 != parent1;
}

double margin_of(const mjModel_* m, const CandidatePair& pair) {
  return pair.defined >= 0 ? m->pair_margin[pair.defined]
                           : m->geom_margin[pair.geom[0]] + m->geom_margin[pair.geom[1]];
}

double gap_of(const mjModel_* m, const CandidatePair& pair) {
  return pair.defined >= 0 ? m->pair_gap[pair.defined]
                           : m->geom_gap[pair.geom[0]] + m->geom_gap[pair.geom[1]];
}

bool have_collision(const mjModel_* m, const CandidatePair& pair) {
  return mjCOLLISIONFUNC[m->geom_type[pair.geom[0]]][m->geom_type[pair.geom[1]]] != nullptr;
}

bool may_have_rows(const mjModel_* m) {
  if (m->opt.disableflags & mjDSBL_CONSTRAINT) return false;
  return may_have_constraints(m) || may_have_contacts(m);
}

BoundingBox bounding_box(const mjModel_* m, const mjData_* d, int geom) {
  BoundingBox box;
  std::copy_n(d->geom_xmat + 9 * geom, 9, box.rotation);
  if (half_widths_of_size(m, geom, box.half)) {
    mju_copy3(box.centre, d->geom_xpos + 3 * geom);
    return box;
  }
  const mjtNum* bounds = m->geom_aabb + 6 * geom;
  mju_mulMatVec3(box.centre, box.rotation, bounds);
  mju_addTo3(box.centre, d->geom_xpos + 3 * geom);
  mju_copy3(box.half, bounds + 3);
  return box;
}

double height_over_plane(const mjData_* d, int plane, const BoundingBox& box) {
  const mjtNum* rotation = d->geom_xmat + 9 * plane;
  const mjtNum normal[3] = {rotation[2], rotation[5], rotation[8]};
  mjtNum apart[3];
  mju_sub3(apart, box.centre, d->geom_xpos + 3 * plane);
  return mju_dot3(apart, normal) - half_width_along(box, normal);
}

double boxes_apart(const BoundingBox& box1, const BoundingBox& box2) {
  mjtNum between[3], along1[3], along2[3];
  mju_sub3(between, box2.centre, box1.centre);
  mju_mulMatTVec3(along1, box1.rotation, between);
  mju_mulMatTVec3(along2, box2.rotation, between);
  double gap1[3], gap2[3];  // along the faces of the first and of the second
  for (int i = 0; i < 3; ++i) {
    gap1[i] = std::abs(along1[i]) - box1.half[i];
    gap2[i] = std::abs(along2[i]) - box2.half[i];
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double cosine = 0.0;
      for (int k = 0; k < 3; ++k) cosine += box1.rotation[3 * k + i] * box2.rotation[3 * k + j];
      cosine = std::abs(cosine);
      gap1[i] -= cosine * box2.half[j];
      gap2[j] -= cosine * box1.half[i];
    }
  return std::max({gap1[0], gap1[1], gap1[2], gap2[0], gap2[1], gap2[2]});
}

void Broadphase::start(const mjModel_* m, const mjData_* d, const std::vector<double>& way,
                       const std::vector<double>& reach) {
  model_ = m;
  data_ = d;
  displacement_ = way.data();
  reach_ = reach.data();
  spans_.clear();
  everywhere_.clear();
  widest_ = 0.0;
  if (m->opt.disableflags & (mjDSBL_CONTACT | mjDSBL_CONSTRAINT)) return;
  for (int geom = 0; geom < m->ngeom; ++geom) {
    if (!may_collide(m, geom)) continue;
    if (!moves_and_collides(m, geom) || m->geom_type[geom] == mjGEOM_PLANE) {
      everywhere_.push_back(geom);
      continue;
    }
    const double radius = m->geom_rbound[geom] + m->geom_margin[geom] + way[geom];
    spans_.push_back({d->geom_xpos[3 * geom] - radius, geom});
    widest_ = std::max(widest_, 2.0 * radius);
  }
  std::sort(spans_.begin(), spans_.end(),
            [](const Span& a, const Span& b) { return a.low < b.low; });
}

const std::vector<BroadphaseNeighbour>& Broadphase::of(int geom) {
  neighbours_.clear();
  const auto add = [&](int other, double margin) {
    if (may_come_near(geom, other, margin)) neighbours_.push_back({other, margin});
  };
  const auto add_unless_filtered = [&](int other) {
    const double margin = model_->geom_margin[geom] + model_->geom_margin[other];
    if (spheres_apart(geom, other) <= margin + displacement_[geom] + displacement_[other] &&
        may_meet(model_, geom, other))
      add(other, margin);
  };
  const bool everywhere = model_->geom_type[geom] == mjGEOM_PLANE;
  const double middle = data_->geom_xpos[3 * geom];
  const double radius =
      everywhere ? std::numeric_limits<double>::infinity()
                 : model_->geom_rbound[geom] + model_->geom_margin[geom] + displacement_[geom];
  auto span = std::lower_bound(spans_.begin(), spans_.end(), middle - radius - widest_,
                               [](const Span& s, double low) { return s.low < low; });
  for (; span != spans_.end() && span->low <= middle + radius; ++span)
    if (span->geom != geom) add_unless_filtered(span->geom);
  for (int other : everywhere_)
    if (other != geom) add_unless_filtered(other);
  for (int pair = 0; pair < model_->npair && !spans_.empty(); ++pair) {
    const int geom1 = model_->pair_geom1[pair], geom2 = model_->pair_geom2[pair];
    if (geom == geom1) add(geom2, model_->pair_margin[pair]);
    if (geom == geom2) add(geom1, model_->pair_margin[pair]);
  }
  return neighbours_;
}

// Of the spheres of bounds; planes have none.
double Broadphase::spheres_apart(int geom1, int geom2) const {
  for (int geom : {geom1, geom2})
    if (model_->geom_type[geom] == mjGEOM_PLANE) return -mjMAXVAL;
  return mju_dist3(data_->geom_xpos + 3 * geom1, data_->geom_xpos + 3 * geom2) -
         model_->geom_rbound[geom1] - model_->geom_rbound[geom2];
}

bool Broadphase::may_come_near(int geom1, int geom2, double margin) const {
  const double way = displacement_[geom1] + displacement_[geom2], within = margin + way;
  if (way <= reach_[geom1] + reach_[geom2] + unknown_overlap(model_, geom1, geom2)) return false;
  if (model_->geom_type[geom1] == mjGEOM_PLANE)
    return height_over_plane(data_, geom1, bounding_box(model_, data_, geom2)) <= within;
  if (model_->geom_type[geom2] == mjGEOM_PLANE)
    return height_over_plane(data_, geom2, bounding_box(model_, data_, geom1)) <= within;
  return spheres_apart(geom1, geom2) <= within &&
         boxes_apart(bounding_box(model_, data_, geom1), bounding_box(model_, data_, geom2)) <=
             within;
}

double unknown_overlap(const mjModel_* m, int geom1, int geom2) {
  return kUnknown * std::min(geom_bounds(m, geom1).half_width, geom_bounds(m, geom2).half_width);
}

int most_contacts(const mjModel_* m, int geom1, int geom2) {
  if (m->geom_type[geom1] > m->geom_type[geom2]) std::swap(geom1, geom2);
  return mj_maxContact(m, geom1, geom2, 1);
}

bool comes_to_limit(const mjModel_* m, const mjData_* d, const std::vector<double>& mean_velocity,
                    double length, ReachBuffers& reach) {
  if (m->opt.disableflags & (mjDSBL_LIMIT | mjDSBL_CONSTRAINT)) return false;
  bool comes = false;
  for (int joint = 0; joint < m->njnt; ++joint) {
    const int type = m->jnt_type[joint], dof = m->jnt_dofadr[joint];
    if (!m->jnt_limited[joint] || (type != mjJNT_HINGE && type != mjJNT_SLIDE)) continue;
    const double way = length * mean_velocity[dof], margin = m->jnt_margin[joint];
    if (std::abs(way) <= reach.dof_reach[dof]) continue;
    const double* range = m->jnt_range + 2 * joint;
    const double at = d->qpos[m->jnt_qposadr[joint]];
    const double apart = way > 0.0 ? range[1] - at : at - range[0];
    if (apart < margin + reach.dof_reach[dof] || apart - std::abs(way) >= margin) continue;
    reach.least_dof_reach[dof] = std::abs(way);
    comes = true;
  }
  return comes;
}

}  // namespace dashpot::host
