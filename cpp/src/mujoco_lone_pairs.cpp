#include "dashpot/mujoco_lone_pairs.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <limits>

#include "dashpot/hit_time.hpp"
#include "dashpot/mujoco_contact_motion.hpp"

namespace dashpot::host {

namespace {

// Whether two contacts are between the same two trees.
bool joins_same(const std::array<int, 2>& a, const std::array<int, 2>& b) {
  return (a[0] == b[0] && a[1] == b[1]) || (a[0] == b[1] && a[1] == b[0]);
}

// The normal of a contact, out of what pushes into the tree on a side.
std::array<double, 3> into_side(const std::array<double, 3>& normal, int side) {
  if (side == 1) return normal;
  return {-normal[0], -normal[1], -normal[2]};
}

}  // namespace

void LonePairs::find(const mjModel_* m, const mjData_* d, double length, const Trees& trees,
                     const double* motion, const std::vector<ContactInput>& contacts) {
  pairs_.clear();
  first_of_tree_.assign(trees.tree.size(), -1);
  ContactMotion of_pair(m, d, length);
  for (auto first = contacts.begin(), last = first; first != contacts.end(); first = last) {
    last = std::find_if(first, contacts.end(),
                        [&](const ContactInput& c) { return !c.is_of_pair(first->geom); });
    double onset = std::numeric_limits<double>::infinity();
    if (std::any_of(first, last, [](const ContactInput& c) { return c.gap <= 0.0; }) ||
        !of_pair.find(*first, trees, motion))
      onset = 0.0;
    else
      for (auto c = first; c != last; ++c)
        onset = std::min(onset, onset_in(length, c->gap, -of_pair.gap_rate(*c)));
    Pair pair{first->geom, first->tree, {-1, -1}, {}, onset};
    std::copy_n(first->frame.begin(), 3, pair.normal.begin());
    for (int side = 0; side < 2; ++side) {
      const int tree = pair.tree[side];
      if (tree < 0 || (side == 0 && tree == pair.tree[1])) continue;
      pair.next[side] = first_of_tree_[tree];
      first_of_tree_[tree] = static_cast<int>(pairs_.size());
    }
    pairs_.push_back(pair);
  }
}

bool LonePairs::is_alone(const ContactInput& contact, double deepest) const {
  const std::array<double, 3> normal{contact.frame[0], contact.frame[1], contact.frame[2]};
  for (int side = 0; side < 2; ++side) {
    const int tree = contact.tree[side];
    if (tree < 0) continue;
    for (int i = first_of_tree_[tree]; i >= 0;) {
      const Pair& pair = pairs_[i];
      const int side_of_pair = pair.tree[1] == tree;
      if (!joins_same(contact.tree, pair.tree) &&
          disturbs_hit(pair.onset, into_side(pair.normal, side_of_pair), into_side(normal, side),
                       deepest))
        return false;
      i = pair.next[side_of_pair];
    }
  }
  return true;
}

}  // namespace dashpot::host
