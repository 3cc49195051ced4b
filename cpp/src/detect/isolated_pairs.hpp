// Which pairs of geoms hit each other alone in a step.
//
// Contacts are found ahead, as far as bodies go in the step by any path: of a corner that falls on
// one tile of a floor those with the tiles beside it, too. Other pairs matter to a hit only if
// their gap closes at the rate that it has, before the hit is at its deepest, or from another side:
// what comes later from the same side is met by a body that has turned back.
//
// A hit that goes on from the last step has what its spring is compressed by in memory: at its
// deepest it has no rate to tell it by.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/turning_step.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Of one step. Contacts of a pair follow each other, and stay where they are meanwhile.
class IsolatedPairs {
 public:
  IsolatedPairs(const mjModel_* m, const mjData_* d, const TurningStep& step,
                const std::vector<ContactInput>& contacts);

  // Slower than this (m/s) nothing is hit.
  double hit_speed() const { return hit_speed_; }

  // Whether nothing else touches the two trees of a contact whose hit is deepest at `deepest` (s).
  bool is_alone(const ContactInput& contact, double deepest) const;
  // What the spring of a contact that was hit in the last step is compressed by (m), else 0.
  double compression(const ContactInput& contact) const;

 private:
  // A pair of geoms, the next pair of either tree, its normal, and when its first gap closes.
  struct Pair {
    std::array<int, 2> tree, next;
    std::array<double, 3> normal;
    double onset;
  };
  // A hit of the last step: its geoms, and its place in memory.
  struct PastHit {
    std::array<int, 2> geom;
    int slot;
  };
  // Kept by the thread from step to step: a step allocates nothing.
  struct Chains {
    std::vector<Pair> pairs;
    std::vector<int> first_of_tree;
    std::vector<PastHit> hits;  // in the order of their geoms
  };

  static Chains& chains();
  double onset(const ContactInput* first, const ContactInput* last) const;

  const mjModel_* model_;
  const mjData_* data_;
  const TurningStep& step_;
  double hit_speed_;
  const Chains& chains_;
};

}  // namespace dashpot::host
