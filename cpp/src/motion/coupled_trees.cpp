#include "dashpot/motion/coupled_trees.hpp"

#include <algorithm>

#include "dashpot/mujoco/trees.hpp"

namespace dashpot {

void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree) {
  first_tree.assign(trees, -1);
  for (bool changed = true; changed;) {
    changed = false;
    for (const RowGroup& c : rows.group) {
      if (c.kind != RowKind::kBilateral) continue;
      int first = c.tree[0];
      for (int tree : c.tree)
        if (tree >= 0 && first_tree[tree] >= 0) first = std::min(first, first_tree[tree]);
      for (int tree : c.tree) {
        if (tree < 0 || first_tree[tree] == first) continue;
        first_tree[tree] = first;
        changed = true;
      }
    }
  }
}

void add_held_trees(const mjModel_* model, const Rows& rows, std::vector<int>& first_tree) {
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact && c.kind != RowKind::kUnilateral) continue;
    for (int tree : c.tree)
      if (tree >= 0 && first_tree[tree] < 0 && !host::is_free_body(model, tree))
        first_tree[tree] = tree;
  }
}

void add_freed_trees(const mjModel_* model, const HeldMotion& before,
                     std::vector<int>& first_tree) {
  for (size_t index = 0; index < first_tree.size(); ++index)
    if (first_tree[index] < 0 && before.length[index] > 0.0 &&
        !host::is_free_body(model, static_cast<int>(index)))
      first_tree[index] = index;
}

}  // namespace dashpot
