#include "dashpot/impacts/impact.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/law/material.hpp"
#include "dashpot/model/trees.hpp"
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

// Of a rigid contact under impact: sqrt(k / m) in units of the inverse length of the substep, as it
// begins and the largest that no more than 64 micro-steps resolve; and its largest damping ratio,
// of restitution 0.01, for stiffness gives way to its square.
constexpr double kImpactRate = 3.5;
constexpr double kResolvedRate = 7.0;
constexpr double kLargestRatio = 5.0;

// Turns a rigid material into the spring of an impact, seen by a contact of apparent inverse mass w
// (1/kg) in a substep of `length` (s): undamped contact would last pi sqrt(m / k) = 0.9 of the
// substep. A contact that is compressed with `stiffness` (N/m, 0 for none) keeps it as far as
// micro-steps of the substep resolve it.
void make_impact_spring(Material& material, double inverse_mass, double length, double stiffness) {
  if (inverse_mass == 0.0) return;
  // N s/m of its own, beside a ratio; at unit stiffness and mass damping is twice its ratio.
  double absolute = material.added_damping, ratio = 0.0;
  if (material.form == DampingForm::kDamping)
    absolute += material.damping;
  else
    ratio = std::min(0.5 * (damping_of(material, 1.0, 1.0) - absolute), kLargestRatio);
  material.form = DampingForm::kRatio;
  material.damping = ratio;
  // Large damping must be resolved too: 2 zeta omega, or d / m, in place of omega.
  material.added_damping = std::min(absolute, kImpactRate / (length * inverse_mass));
  material.rigid = false;
  const double rate = kImpactRate / (length * std::max(1.0, 2.0 * ratio));
  material.stiffness = rate * rate / inverse_mass;
  if (stiffness == 0.0) return;
  const double stiffest = std::pow(kResolvedRate / kImpactRate, 2) * material.stiffness;
  material.stiffness = std::min(stiffest, stiffness);
}

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

void give_back_way(const Rows& rows, const RowData& data, double length,
                   const std::vector<ConstraintInput>& start_constraints,
                   std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  for (const RowGroup& c : rows.group) {
    const double load = first_rate(rows, c, data.smooth_acceleration) + c.surface_acceleration[0];
    const double way = 0.5 * length * (first_rate(rows, c, data.velocity) + 0.25 * length * load);
    if (c.kind == RowKind::kContact) {
      contacts[c.input].gap -= way;
      continue;
    }
    ConstraintInput& constraint = constraints[c.input];
    constraint.position -= way;
    for (const ConstraintInput& same : start_constraints)
      if (same.memory == constraint.memory) constraint.position = same.position;
  }
}

void give_rigid_impacts_springs(const Memory& memory, const std::vector<GeomPair>& impact,
                                const std::vector<ContactInput>& contacts, const Rows& rows,
                                double length, std::vector<GroupMaterial>& materials) {
  std::map<GeomPair, double> compressed;
  for (int i = 0; i < memory.contact_count(); ++i) {
    const RememberedContact contact = memory.contact(i);
    double& stiffness = compressed[{int(contact.geom[0]), int(contact.geom[1])}];
    stiffness = std::max(stiffness, contact.stiffness);
  }
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact || !materials[i].is_rigid()) continue;
    const GeomPair& pair = contacts[c.input].geom;
    if (!std::binary_search(impact.begin(), impact.end(), pair)) continue;
    const auto before = compressed.find(pair);
    make_impact_spring(materials[i].material, rows.inverse_mass[c.row], length,
                       before == compressed.end() ? 0.0 : before->second);
  }
}

}  // namespace dashpot
