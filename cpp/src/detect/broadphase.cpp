#include "dashpot/detect/broadphase.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "dashpot/detect/bounds.hpp"
#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/detect/pair_filters.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot::host {

namespace {

// Fraction of the least half-width of two geoms: a tenth of what rigid contacts may sag by.
constexpr double kUnknown = 1e-4;

}  // namespace

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
