#include "dashpot/impacts/impact.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/rows/step_clock.hpp"
#include "fast_pairs.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr double kTurnInContact = 0.005;  // rad, in a substep with contact
constexpr double kShortestSubstep =
    1e-6;  // of the rest of a step: substeps shorter than this are not cut

class ImpactSearch {
 public:
  ImpactSearch(const mjModel_* model, const mjData_* data, double remaining, FastPairs& fast)
      : model_(model), data_(data), remaining_(remaining), fast_(fast), pairs_(fast.pairs) {}

  // The motion over a shorter substep is nearer to its mean: a second look at the pairs that limit
  // substep sharpens the first.
  double find_length(int cuts_left) {
    const double shortest_contact = remaining_ / (2.0 * cuts_left);
    double longest = remaining_;
    const auto look = [&](FastPair& pair, double length) {
      longest = std::min(longest, examine(pair, length, shortest_contact));
    };
    for (FastPair& pair : pairs_) look(pair, remaining_);
    const double length = longest;
    for (FastPair& pair : pairs_)
      if (!pair.apart || pair.clear <= length) look(pair, length);
    longest = std::max(longest, kShortestSubstep * remaining_);
    return longest > (1.0 - kShortestSubstep) * remaining_ ? remaining_ : longest;
  }

  std::vector<GeomPair> pairs_in_touch() const {
    std::vector<GeomPair> touching;
    for (const FastPair& pair : pairs_)
      if (!pair.apart) touching.push_back(pair.geoms());
    std::sort(touching.begin(), touching.end());
    return touching;
  }

  // Pairs that fly apart of each other, undisturbed.
  std::vector<GeomPair> pairs_apart(const std::vector<ConstraintInput>& constraints,
                                    const std::vector<ContactInput>& contacts) const {
    std::vector<char> disturbed(host::tree_count(model_), 0);
    bool changed = false;
    const auto disturb = [&](int tree) {
      if (tree < 0 || disturbed[tree]) return;
      disturbed[tree] = 1;
      changed = true;
    };
    const auto is_disturbed = [&](int tree) { return tree >= 0 && disturbed[tree]; };
    for (const ConstraintInput& constraint : constraints)
      for (int tree : constraint.tree) disturb(tree);
    for (const FastPair& pair : pairs_)
      if (!pair.apart)
        for (const SideMotion& side : pair.side) disturb(side.tree);
    const auto drops = [&](const FastPair& pair) {
      return pair.apart && pair.flies && !is_disturbed(pair.side[0].tree) &&
             !is_disturbed(pair.side[1].tree);
    };
    // What an impact disturbs, it may hand on through any contact with rows.
    do {
      changed = false;
      for (size_t i = 0; i < contacts.size(); ++i) {
        const auto& tree = contacts[i].tree;
        const int index = fast_.pair_of_contact[i];
        if (index >= 0 && drops(pairs_[index])) continue;
        if (!is_disturbed(tree[0]) && !is_disturbed(tree[1])) continue;
        for (int t : tree) disturb(t);
      }
    } while (changed);
    std::vector<GeomPair> apart;
    for (const FastPair& pair : pairs_)
      if (drops(pair)) apart.push_back(pair.geoms());
    std::sort(apart.begin(), apart.end());
    return apart;
  }

 private:
  // How long the pair allows the substep to last, at most `length`.
  double examine(FastPair& pair, double length, double shortest_contact) const {
    Shape shape[2];
    Pose pose[2];
    Motion motion[2];
    for (int i = 0; i < 2; ++i) {
      const SideMotion& side = pair.side[i];
      shape[i] = geom_shape(model_, side.geom);
      pose[i] = geom_pose(model_, data_, side.geom);
      motion[i] = side.mean_motion(length);
      if (shape[i].type == ShapeType::kPlane && !motion[i].angular.isZero(0.0)) return length;
    }
    const double standoff = pair.standoff(length);
    const Distance now = distance(shape[0], pose[0], shape[1], pose[1]);
    pair.apart = now.distance - pair.margin > 2.0 * standoff;
    if (pair.apart) {
      try {
        pair.clear = time_of_impact(shape[0], pose[0], motion[0], shape[1], pose[1], motion[1],
                                    length, pair.margin + standoff)
                         .time;
        if (pair.clear > kSliverOfStep * length) return pair.clear;
      } catch (const UndecidedImpact&) {
      }
      // They hover at the standoff, or it is finer than geoms as large are known: rows take care.
      pair.apart = false;
      return length;
    }
    const double speed = pair.closing_speed(now.normal, length) + pair.release_speed;
    if (!fast_.is_fast(pair, speed, now.normal, length)) return length;
    const double calm = std::min(kFastMotion * pair.half_width / speed,
                                 kTurnInContact / pair.turn_rate(speed, now.normal, length));
    return std::min(length, std::max(calm, shortest_contact));
  }

  const mjModel_* model_;
  const mjData_* data_;
  const double remaining_;
  const FastPairs& fast_;
  std::vector<FastPair>& pairs_;
};

}  // namespace

Substep substep_before_impact(const mjModel_* model, const mjData_* data, const Memory& memory,
                              const std::vector<double>& acceleration,
                              const std::vector<ConstraintInput>& constraints,
                              const std::vector<ContactInput>& contacts, const StepClock& clock) {
  const int cuts_left = kMaxCuts - clock.cuts;
  Substep substep;
  substep.length = clock.length;
  if (contacts.empty()) return substep;
  FastPairs fast(model, data, memory, acceleration, clock.whole, clock.length);
  fast.find(contacts);
  if (fast.pairs.empty()) return substep;
  ImpactSearch search(model, data, clock.length, fast);
  const double length = search.find_length(cuts_left);
  substep.impact = search.pairs_in_touch();
  if (cuts_left == 0) return substep;
  substep.length = length;
  substep.apart = search.pairs_apart(constraints, contacts);
  return substep;
}

void drop_pairs(const std::vector<GeomPair>& pairs, std::vector<ContactInput>& contacts) {
  if (pairs.empty()) return;
  const auto is_dropped = [&](const ContactInput& contact) {
    return std::binary_search(pairs.begin(), pairs.end(), contact.geom);
  };
  contacts.erase(std::remove_if(contacts.begin(), contacts.end(), is_dropped), contacts.end());
}

}  // namespace dashpot
