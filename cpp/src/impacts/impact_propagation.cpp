#include "dashpot/impacts/impact_propagation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <tuple>

#include "dashpot/geometry/query.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

// Fraction of the way beyond the reach of detection that may be unknown: links of a robot at rest
// change their ways by some hundredths with the forces of rows, what is hit by a multiple.
constexpr double kFarther = 0.05;
// Fraction of the way by which a known pair may end deeper than its contacts say: rows that turn
// leave out half of it for each radian.
constexpr double kTolerance = 0.01;

GeomPair sorted(int geom1, int geom2) { return {std::min(geom1, geom2), std::max(geom1, geom2)}; }

}  // namespace

void ImpactPropagation::find_displacements(const mjModel_* model, const mjData_* data,
                                           const std::vector<double>& mean_velocity, double length,
                                           const host::ReachBuffers& reach) {
  host::body_velocities(model, data, mean_velocity.data(), body_velocity_);
  const int geoms = host::geom_count(model);
  displacement_.assign(geoms, 0.0);
  far_.clear();
  for (int geom = 0; geom < geoms; ++geom) {
    if (!host::moves_and_collides(model, geom)) continue;
    displacement_[geom] = length * host::geom_speed(model, data, geom, body_velocity_.data());
    if (displacement_[geom] - reach.reach[geom] > kFarther * displacement_[geom])
      far_.push_back(geom);
  }
}

void ImpactPropagation::find_astray(const mjModel_* model, const mjData_* data, double length,
                                    const std::vector<host::NarrowedPair>& narrowed) {
  astray_.clear();
  for (const host::NarrowedPair& pair : narrowed) {
    const auto [geom1, geom2] = pair.geom;
    const double way =
        length * host::relative_speed(model, data, geom1, geom2, body_velocity_.data());
    const double farther = std::max(kFarther * way, host::unknown_overlap(model, geom1, geom2));
    if (way - pair.reach > farther) astray_.push_back({pair.geom, pair.margin, way});
  }
}

void ImpactPropagation::find_known(const std::vector<ContactInput>& contacts,
                                   const std::vector<double>& end_gap) {
  known_.clear();
  asked_ = far_;
  for (const Astray& pair : astray_)
    asked_.insert(asked_.end(), pair.geom.begin(), pair.geom.end());
  std::sort(asked_.begin(), asked_.end());
  const auto is_asked = [&](const ContactInput& c) {
    return !c.is_of_flex() && std::any_of(c.geom.begin(), c.geom.end(), [&](int geom) {
      return std::binary_search(asked_.begin(), asked_.end(), geom);
    });
  };
  for (size_t i = 0; i < contacts.size(); ++i)
    if (is_asked(contacts[i]))
      known_.push_back(
          {sorted(contacts[i].geom[0], contacts[i].geom[1]), end_gap[i], &contacts[i]});
  std::sort(known_.begin(), known_.end(), [](const Known& a, const Known& b) {
    return std::tie(a.geom, a.end_gap) < std::tie(b.geom, b.end_gap);
  });
}

// Whether two geoms overlap where their ways lead, unknown to their contacts. Those without any are
// seen as detection would: along the normal through their nearest points.
bool ImpactPropagation::meets(const mjModel_* model, const mjData_* data, int geom1, int geom2,
                              double margin, double way, double length) {
  if (!has_shape(model, geom1) || !has_shape(model, geom2)) return false;
  const double unknown = host::unknown_overlap(model, geom1, geom2);
  const int geom[2] = {geom1, geom2};
  const Shape* shape[2];
  Pose pose[2];
  Motion motion[2];
  for (int side = 0; side < 2; ++side) {
    const int body = geom_body(model, geom[side]);
    shape[side] = &shapes_.of(model, geom[side]);
    pose[side] = geom_pose(model, data, geom[side]);
    motion[side] = body_motion(model, data, body, body_velocity_.data() + 6 * body);
  }
  const GeomPair pair = sorted(geom1, geom2);
  const auto known = std::lower_bound(known_.begin(), known_.end(), pair,
                                      [](const Known& k, const GeomPair& p) { return k.geom < p; });
  if (known == known_.end() || known->geom != pair) {
    const double clearance = margin + way - unknown;
    if (are_farther_apart(*shape[0], pose[0], *shape[1], pose[1], clearance)) return false;
    const Distance now = distance(*shape[0], pose[0], *shape[1], pose[1]);
    double rate = 0.0;
    for (int side = 0; side < 2; ++side) {
      const Eigen::Vector3d arm = (side ? now.point2 : now.point1) - motion[side].centre;
      rate += (side ? 1.0 : -1.0) *
              now.normal.dot(motion[side].linear + motion[side].angular.cross(arm));
    }
    return now.distance - margin + length * rate < -unknown;
  }
  const auto last = std::upper_bound(known, known_.end(), pair,
                                     [](const GeomPair& p, const Known& k) { return p < k.geom; });
  if (last - known >= host::most_contacts(model, geom1, geom2)) return false;
  for (int side = 0; side < 2; ++side) pose[side] = advance(pose[side], motion[side], length);
  const double deepest = std::min(0.0, known->end_gap) - std::max(kTolerance * way, unknown);
  if (has_core(*shape[0]) && has_core(*shape[1])) {
    const Eigen::Vector3d normal = Eigen::Map<const Eigen::Vector3d>(known->contact->frame.data());
    const double sign = known->contact->geom[0] == geom1 ? 1.0 : -1.0;
    if (gap_along(*shape[0], pose[0], *shape[1], pose[1], sign * normal) - margin >= deepest)
      return false;
  }
  return distance(*shape[0], pose[0], *shape[1], pose[1]).distance - margin < deepest;
}

bool ImpactPropagation::comes_to_more(const mjModel_* model, const mjData_* data,
                                      const std::vector<double>& mean_velocity, double length,
                                      const std::vector<ContactInput>& contacts,
                                      const std::vector<double>& end_gap,
                                      const std::vector<host::NarrowedPair>& narrowed,
                                      host::ReachBuffers& reach) {
  find_displacements(model, data, mean_velocity, length, reach);
  bool more = host::comes_to_limit(model, data, mean_velocity, length, reach);
  find_astray(model, data, length, narrowed);
  if (far_.empty() && astray_.empty()) return more;
  find_known(contacts, end_gap);
  const auto widen = [&](int geom1, int geom2) {
    for (int geom : {geom1, geom2})
      reach.least_reach[geom] = std::max(reach.least_reach[geom], displacement_[geom]);
    more = true;
  };
  for (const Astray& pair : astray_)
    if (meets(model, data, pair.geom[0], pair.geom[1], pair.margin, pair.way, length))
      widen(pair.geom[0], pair.geom[1]);
  if (far_.empty()) return more;
  broadphase_.start(model, data, displacement_, reach.reach);
  for (int geom : far_) {
    for (const auto& [other, margin] : broadphase_.of(geom))
      if (meets(model, data, geom, other, margin, displacement_[geom] + displacement_[other],
                length))
        widen(geom, other);
  }
  return more;
}

}  // namespace dashpot
