#include "dashpot/knock_on.hpp"

#include <algorithm>

#include "dashpot/mujoco_host.hpp"
#include "dashpot/mujoco_partners.hpp"
#include "dashpot/query.hpp"

namespace dashpot {

namespace {

GeomPair sorted(int geom1, int geom2) { return {std::min(geom1, geom2), std::max(geom1, geom2)}; }

}  // namespace

void KnockOn::find_ways(const mjModel_* model, const mjData_* data,
                        const std::vector<double>& mean_velocity, double length,
                        const host::ReachBuffers& reach) {
  host::body_velocities(model, data, mean_velocity.data(), body_velocity_);
  const int geoms = host::geom_count(model);
  way_.assign(geoms, 0.0);
  far_.clear();
  for (int geom = 0; geom < geoms; ++geom) {
    if (!host::moves_and_collides(model, geom)) continue;
    way_[geom] = length * host::geom_speed(model, data, geom, body_velocity_.data());
    if (way_[geom] > reach.reach[geom]) far_.push_back(geom);
  }
}

// Whether two geoms that have no contact overlap where their ways lead, seen as detection sees
// contacts: along the normal through their nearest points.
bool KnockOn::meets(const mjModel_* model, const mjData_* data, int geom1, int geom2, double margin,
                    double length, const host::ReachBuffers& reach) {
  const double way = way_[geom1] + way_[geom2];
  // Detection would have found them.
  if (way <= reach.reach[geom1] + reach.reach[geom2]) return false;
  if (host::bounds_apart(model, data, geom1, geom2) > margin + way) return false;
  if (!has_shape(model, geom1) || !has_shape(model, geom2)) return false;
  if (std::binary_search(known_.begin(), known_.end(), sorted(geom1, geom2))) return false;
  const Distance now = distance(shapes_.of(model, geom1), geom_pose(model, data, geom1),
                                shapes_.of(model, geom2), geom_pose(model, data, geom2));
  double rate = 0.0;
  for (int side = 0; side < 2; ++side) {
    const int body = geom_body(model, side ? geom2 : geom1);
    const Motion motion = body_motion(model, data, body, body_velocity_.data() + 6 * body);
    const Eigen::Vector3d& point = side ? now.point2 : now.point1;
    rate += (side ? 1.0 : -1.0) *
            now.normal.dot(motion.linear + motion.angular.cross(point - motion.centre));
  }
  return now.distance - margin + length * rate < 0.0;
}

bool KnockOn::comes_to_more(const mjModel_* model, const mjData_* data,
                            const std::vector<double>& mean_velocity, double length,
                            const std::vector<ContactInput>& contacts, host::ReachBuffers& reach) {
  find_ways(model, data, mean_velocity, length, reach);
  bool more = host::comes_to_limit(model, data, mean_velocity, length, reach);
  if (far_.empty()) return more;
  known_.clear();
  for (const ContactInput& contact : contacts)
    if (!contact.is_of_flex()) known_.push_back(sorted(contact.geom[0], contact.geom[1]));
  std::sort(known_.begin(), known_.end());
  for (int geom : far_)
    host::for_each_partner(model, geom, [&](int other, double margin) {
      if (!meets(model, data, geom, other, margin, length, reach)) return;
      for (int side : {geom, other})
        reach.least_reach[side] = std::max(reach.least_reach[side], way_[side]);
      more = true;
    });
  return more;
}

}  // namespace dashpot
