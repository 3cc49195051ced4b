#include "isolated_pairs.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <limits>

#include "contact_motion.hpp"
#include "dashpot/geometry/squared_distance.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot::host {

namespace {

// The normal of a contact, out of what pushes into the tree on a side.
std::array<double, 3> into_side(const std::array<double, 3>& normal, int side) {
  if (side == 1) return normal;
  return {-normal[0], -normal[1], -normal[2]};
}

}  // namespace

IsolatedPairs::Chains& IsolatedPairs::chains() {
  thread_local Chains chains;
  return chains;
}

IsolatedPairs::IsolatedPairs(const mjModel_* m, const mjData_* d, const TurningStep& step,
                             const std::vector<ContactInput>& contacts)
    : model_(m), data_(d), step_(step), hit_speed_(kHitSpeed * metre(m)), chains_(chains()) {
  const Memory& memory = step.memory;
  auto& [pairs, first_of_tree, hits] = chains();
  hits.clear();
  for (int slot = 0; slot < memory.contact_count(); ++slot)
    if (memory.parted_hit(slot) > 0.0) hits.push_back({memory.geoms(slot), slot});
  std::sort(hits.begin(), hits.end(), [](const PastHit& a, const PastHit& b) {
    return a.geom != b.geom ? a.geom < b.geom : a.slot < b.slot;
  });
  pairs.clear();
  first_of_tree.assign(step.trees.tree.size(), -1);
  const ContactInput* const end = contacts.data() + contacts.size();
  for (const ContactInput *first = contacts.data(), *last = first; first != end; first = last) {
    last =
        std::find_if(first, end, [&](const ContactInput& c) { return !c.is_of_pair(first->geom); });
    Pair pair{first->tree,
              {-1, -1},
              {first->frame[0], first->frame[1], first->frame[2]},
              onset(first, last)};
    for (int side = 0; side < 2; ++side) {
      const int tree = first->tree[side];
      if (tree < 0 || (side == 0 && tree == first->tree[1])) continue;
      pair.next[side] = first_of_tree[tree];
      first_of_tree[tree] = static_cast<int>(pairs.size());
    }
    pairs.push_back(pair);
  }
}

bool IsolatedPairs::is_alone(const ContactInput& contact, double deepest) const {
  const std::array<double, 3> normal{contact.frame[0], contact.frame[1], contact.frame[2]};
  for (int side = 0; side < 2; ++side) {
    const int tree = contact.tree[side];
    if (tree < 0) continue;
    for (int i = chains_.first_of_tree[tree]; i >= 0;) {
      const Pair& pair = chains_.pairs[i];
      const int side_of_other = pair.tree[1] == tree;
      if (!joins_same_trees(contact.tree, pair.tree) &&
          disturbs_hit(pair.onset, into_side(pair.normal, side_of_other), into_side(normal, side),
                       deepest))
        return false;
      i = pair.next[side_of_other];
    }
  }
  return true;
}

double IsolatedPairs::compression(const ContactInput& contact) const {
  const auto comes_before = [](const PastHit& hit, const std::array<int, 2>& geom) {
    return hit.geom < geom;
  };
  double nearest = std::numeric_limits<double>::infinity(), compression = 0.0;
  for (auto hit =
           std::lower_bound(chains_.hits.begin(), chains_.hits.end(), contact.geom, comes_before);
       hit != chains_.hits.end() && hit->geom == contact.geom; ++hit) {
    const double distance = dashpot::squared_distance(step_.memory.position(hit->slot, 0),
                                                      contact.local_position[0].data());
    if (distance >= nearest) continue;
    nearest = distance;
    compression = step_.memory.parted_hit(hit->slot);
  }
  return compression;
}

// When the first gap of a pair closes (s), infinite if none does in the step.
double IsolatedPairs::onset(const ContactInput* first, const ContactInput* last) const {
  ContactMotion motion(model_, data_, step_.length);
  if (std::any_of(first, last, [](const ContactInput& c) { return c.gap <= 0.0; }) ||
      !motion.find(*first, step_))
    return 0.0;
  double least = std::numeric_limits<double>::infinity();
  for (const ContactInput* c = first; c != last; ++c)
    least = std::min(least, onset_in(step_.length, c->gap, -motion.gap_rate(*c)));
  return least;
}

}  // namespace dashpot::host
