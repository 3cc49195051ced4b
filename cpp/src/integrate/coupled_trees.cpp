#include "coupled_trees.hpp"

#include <algorithm>

namespace dashpot {

void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree) {
  first_tree.assign(trees, -1);
  for (bool changed = true; changed;) {
    changed = false;
    for (int index : rows.equality) {
      const RowGroup& c = rows.group[index];
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

}  // namespace dashpot
