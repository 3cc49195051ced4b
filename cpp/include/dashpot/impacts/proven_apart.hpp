// What is known of pairs of geoms that fly apart of each other.

#pragma once

#include <array>
#include <map>
#include <vector>

namespace dashpot {

using GeomPair = std::array<int, 2>;

// Pairs of free or fixed bodies that earlier parts of a step have proven apart up to some time.
// What disturbs neither of the two leaves that proof valid.
class ProvenApart {
 public:
  // How long (s) the proof for a pair holds from now, `remaining` (s) before the end of the step; 0
  // if it does not.
  double time_left(const GeomPair& pair, double remaining) const;
  // Adds a pair that is proven apart up to `end` (s) before the end of the step.
  void add(const GeomPair& pair, const std::array<int, 2>& tree, double end);
  void forget(const std::vector<char>& disturbed);  // by tree
  void clear() { entries_.clear(); }

 private:
  struct Entry {
    std::array<int, 2> tree;
    double end;
  };
  std::map<GeomPair, Entry> entries_;
};

}  // namespace dashpot
