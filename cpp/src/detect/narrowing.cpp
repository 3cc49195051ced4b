#include "dashpot/detect/narrowing.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/geometry/slots_by_pair.hpp"

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

// Fraction of a distance found that counts: searches end before they are exact.
constexpr double kSure = 0.9;
// How far distances are looked for beyond contacts: a fraction of the smaller geom's radius.
constexpr double kLook = 0.2;
// A distance is worth its search where it lasts for steps; of nearer pairs it is searched seldom.
constexpr double kStepsWorth = 2.0;
constexpr int kWaits = 32;
// Pairs kept. More come from many bodies that move among each other; then it begins anew.
constexpr size_t kMostKept = 4096;

// Whether MuJoCo searches for the distance of two geoms, and climbs over the vertices of a mesh, so
// that a distance known saves time. Without one a search takes no longer than all of this: heaps of
// ellipsoids step 10 % slower.
bool is_worth_keeping(const mjModel* m, const CandidatePair& pair) {
  const int type1 = m->geom_type[pair.geom[0]];
  return m->geom_type[pair.geom[1]] == mjGEOM_MESH && type1 != mjGEOM_PLANE &&
         type1 != mjGEOM_HFIELD;
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

PairsApart::Placement PairsApart::place(const mjModel_* m, const mjData_* d,
                                        const CandidatePair& pair) {
  const int geom1 = pair.geom[0], geom2 = pair.geom[1];
  const mjtNum *rotation1 = d->geom_xmat + 9 * geom1, *rotation2 = d->geom_xmat + 9 * geom2;
  Placement placement;
  mjtNum between[3];
  mju_sub3(between, d->geom_xpos + 3 * geom2, d->geom_xpos + 3 * geom1);
  mju_mulMatTVec3(placement.position.data(), rotation1, between);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double sum = 0.0;
      for (int k = 0; k < 3; ++k) sum += rotation1[3 * k + i] * rotation2[3 * k + j];
      placement.rotation[3 * i + j] = sum;
    }
  for (int side = 0; side < 2; ++side) {
    const int geom = pair.geom[side];
    double* const extent = placement.extent.data() + 12 * side;
    std::copy_n(m->geom_size + 3 * geom, 3, extent);
    std::copy_n(m->geom_aabb + 6 * geom, 6, extent + 3);
    extent[9] = m->geom_rbound[geom];
    extent[10] = m->geom_type[geom];
    extent[11] = m->geom_dataid[geom];
  }
  return placement;
}

bool PairsApart::are_apart(const mjModel_* m, const mjData_* d, const CandidatePair& pair,
                           double within) {
  if (!is_worth_keeping(m, pair)) return false;
  const std::optional<Known> before = known(pair);
  if (!before || before->distance <= within) return false;
  const Placement &then = before->placement, now = place(m, d, pair);
  if (now.extent != then.extent) return false;
  double shift = 0.0, turn = 0.0;
  for (int i = 0; i < 3; ++i) shift += std::pow(now.position[i] - then.position[i], 2);
  for (int i = 0; i < 9; ++i) turn += std::pow(now.rotation[i] - then.rotation[i], 2);
  const double way = std::sqrt(shift) + m->geom_rbound[pair.geom[1]] * std::sqrt(0.5 * turn);
  return before->distance - way > within;
}

void PairsApart::find_distance(const mjModel_* m, mjData_* d, const CandidatePair& pair,
                               double within) {
  if (!is_worth_keeping(m, pair)) return;
  const double radius = std::min(m->geom_rbound[pair.geom[0]], m->geom_rbound[pair.geom[1]]);
  const double farthest = within + kLook * radius, worth = (1.0 + kStepsWorth) * within;
  if (!(kSure * farthest > worth)) return;
  Known now = known(pair).value_or(Known());
  if (now.waits > 0) {
    --now.waits;
    return keep(pair, now);
  }
  // Geoms hold their centres: no distance is more than that of these. MuJoCo's search finds nothing
  // where two meshes are in one place, as if they were far apart.
  const double centres =
      mju_dist3(d->geom_xpos + 3 * pair.geom[0], d->geom_xpos + 3 * pair.geom[1]);
  const double searched = distance_of_convex(m, d, pair.geom[0], pair.geom[1], farthest);
  const double distance = kSure * std::min(searched, centres);
  keep(pair, {place(m, d, pair), distance, distance > worth ? 0 : kWaits});
}

void PairsApart::make_room() {
  if (known_.size() >= kMostKept) known_.clear();
}

std::optional<PairsApart::Known> PairsApart::known(const CandidatePair& pair) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = known_.find(pair_key(pair.geom[0], pair.geom[1]));
  return found == known_.end() ? std::nullopt : std::optional<Known>(found->second);
}

void PairsApart::keep(const CandidatePair& pair, const Known& known) {
  const std::lock_guard<std::mutex> lock(mutex_);
  known_[pair_key(pair.geom[0], pair.geom[1])] = known;
}

}  // namespace dashpot::host
