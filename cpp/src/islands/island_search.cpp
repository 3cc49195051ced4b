// Which rows and trees are connected.

#include <algorithm>
#include <numeric>

#include "dashpot/islands/islands.hpp"

namespace dashpot {

const std::vector<Island>& Islands::find(const Rows& rows, const Trees& trees) {
  const int tree_count = static_cast<int>(trees.tree.size());
  root_.resize(tree_count);
  std::iota(root_.begin(), root_.end(), 0);
  const auto find_root = [&](int tree) {
    while (root_[tree] != tree) tree = root_[tree] = root_[root_[tree]];
    return tree;
  };
  // A tree of each group that can be loaded, -1 of others.
  const int group_count = static_cast<int>(rows.group.size());
  tree_of_.resize(group_count);
  for (int i = 0; i < group_count; ++i) {
    const RowGroup& c = rows.group[i];
    tree_of_[i] = !c.can_be_loaded ? -1 : c.tree[0] >= 0 ? c.tree[0] : c.tree[1];
    if (c.can_be_loaded && c.tree[0] >= 0 && c.tree[1] >= 0) {
      const int a = find_root(c.tree[0]), b = find_root(c.tree[1]);
      root_[std::max(a, b)] = std::min(a, b);
    }
  }
  // Number islands by their first group, then count and sort groups and trees into them.
  island_of_.assign(tree_count, -1);
  int count = 0;
  for (int tree : tree_of_) {
    if (tree < 0) continue;
    int& island = island_of_[find_root(tree)];
    if (island < 0) island = count++;
  }
  islands_.assign(count, Island{});
  const auto sort_into = [&](std::vector<int>& order, int members, const auto& island_of_member,
                             Indices Island::*range) {
    first_.assign(count + 1, 0);
    for (int i = 0; i < members; ++i)
      if (const int island = island_of_member(i); island >= 0) ++first_[island + 1];
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    order.resize(first_.back());
    for (int island = 0; island < count; ++island)
      (islands_[island].*range).first = (islands_[island].*range).last =
          order.data() + first_[island];
    for (int i = 0; i < members; ++i)
      if (const int island = island_of_member(i); island >= 0)
        order[(islands_[island].*range).last++ - order.data()] = i;
  };
  sort_into(
      group_order_, group_count,
      [&](int i) { return tree_of_[i] < 0 ? -1 : island_of_[find_root(tree_of_[i])]; },
      &Island::group);
  sort_into(
      tree_order_, tree_count, [&](int i) { return island_of_[find_root(i)]; }, &Island::tree);
  island_at_.clear();
  for (int island = 0; island < count; ++island)
    island_at_.insert(island_at_.end(), islands_[island].group_count(), island);
  sort_sides(rows, tree_count);
  return islands_;
}

// By tree, in the order of groups, so that every sum over them has one.
void Islands::sort_sides(const Rows& rows, int tree_count) {
  first_side_.assign(tree_count + 1, 0);
  trees_of_order_.clear();
  for (int index : group_order_) {
    trees_of_order_.push_back(rows.group[index].tree);
    for (int tree : trees_of_order_.back())
      if (tree >= 0) ++first_side_[tree + 1];
  }
  std::partial_sum(first_side_.begin(), first_side_.end(), first_side_.begin());
  side_order_.resize(first_side_.back());
  first_.assign(first_side_.begin(), first_side_.end());
  for (size_t at = 0; at < group_order_.size(); ++at)
    for (int side = 0; side < 2; ++side)
      if (const int tree = trees_of_order_[at][side]; tree >= 0)
        side_order_[first_[tree]++] = 2 * group_order_[at] + side;
}

}  // namespace dashpot
