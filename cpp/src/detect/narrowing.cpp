#include "dashpot/detect/narrowing.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/detect/reach.hpp"

namespace dashpot::host {

namespace {

// Fraction of the least half-width of two geoms that contacts are looked for at least: what forces
// make of the ways of links that go together is seldom more.
constexpr double kLeastReach = 0.01;

double least_half_width(const mjModel* m, const CandidatePair& pair) {
  double least = mjMAXVAL;
  for (int geom : pair.geom) {
    if (m->geom_type[geom] == mjGEOM_PLANE) continue;
    const mjtNum* half = m->geom_aabb + 6 * geom + 3;
    least = std::min({least, half[0], half[1], half[2]});
  }
  return least;
}

}  // namespace

void Narrowing::start(const ReachBuffers& reach) {
  reach_ = &reach;
  pairs_.clear();
}

double Narrowing::within(const mjModel_* m, const mjData_* d, const CandidatePair& pair,
                         std::vector<NarrowedPair>& narrowed) const {
  const auto [geom1, geom2] = pair.geom;
  if (reach_->least_reach[geom1] > 0.0 || reach_->least_reach[geom2] > 0.0) return pair.within;
  const double margin = margin_of(m, pair), reach = pair.within - margin;
  const double least =
      std::max(reach_->own_gap(pair.geom, pair.defined), kLeastReach * least_half_width(m, pair));
  if (reach <= least) return pair.within;
  const double speed = std::max(relative_speed(m, d, geom1, geom2, reach_->now.data()),
                                relative_speed(m, d, geom1, geom2, reach_->later.data()));
  const double narrower = std::max(least, m->opt.timestep * speed);
  if (narrower >= reach) return pair.within;
  narrowed.push_back({pair.geom, margin, narrower});
  return margin + narrower;
}

}  // namespace dashpot::host
