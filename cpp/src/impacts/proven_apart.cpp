#include "dashpot/impacts/proven_apart.hpp"

#include <algorithm>
#include <iterator>

namespace dashpot {

double ProvenApart::time_left(const GeomPair& pair, double remaining) const {
  const auto entry = entries_.find(pair);
  return entry == entries_.end() ? 0.0 : std::max(0.0, remaining - entry->second.end);
}

void ProvenApart::add(const GeomPair& pair, const std::array<int, 2>& tree, double end) {
  entries_[pair] = {tree, end};
}

void ProvenApart::forget(const std::vector<char>& disturbed) {
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    const auto& tree = entry->second.tree;
    const bool lost = (tree[0] >= 0 && disturbed[tree[0]]) || (tree[1] >= 0 && disturbed[tree[1]]);
    entry = lost ? entries_.erase(entry) : std::next(entry);
  }
}

}  // namespace dashpot
