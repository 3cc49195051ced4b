// The hits of two geoms: which contacts are hit in a step, and when that force acts (rows/hit.hpp).
//
// A hit is known of two bodies that hit each other alone (IsolatedPairs). Of most it counts where
// it is over within the step: what lasts longer goes by the geometry of every step. The normal of
// two round bodies turns on all the while, v_t / (r_1 + r_2), and a step in which the hit begins or
// ends has its force at one end: theirs are followed however long, if of SI stiffness.

#pragma once

#include <array>
#include <vector>

#include "contact_motion.hpp"
#include "dashpot/detect/turning.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

// Which pairs of geoms hit each other alone in a step.
//
// Contacts are found ahead, as far as bodies go in the step by any path: of a corner that falls on
// one tile of a floor those with the tiles beside it, too. Other pairs matter to a hit only if
// their gap closes at the rate that it has, before the hit is at its deepest, or from another side:
// what comes later from the same side is met by a body that has turned back.
//
// A hit that goes on from the last step has what its spring is compressed by in memory: at its
// deepest it has no rate to tell it by.
//
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

class PairHits {
 public:
  // Of a pair that moves as `motion` has it.
  PairHits(const ContactMotion& motion, const TurningStep& step, const IsolatedPairs& pairs)
      : motion_(motion), step_(step), pairs_(pairs) {}

  // sqrt(k w) (rad/s) of a contact that is hit, or flies off; else 0.
  double frequency(const ContactInput& contact) const;
  // Whether a contact is softer than micro-steps resolve. What is as stiff as they do is hit for as
  // long as they are, and acts where that begins.
  bool is_soft(const ContactInput& contact) const;
  // Compression (m) of such a contact of two round bodies that was hit in the last step; else 0.
  double compression(const ContactInput& contact) const;
  // When a contact's gap closes at its rate: 0 if closed, the step's length if not within it.
  double onset(const ContactInput& contact) const;
  // When the force of the hit of a contact acts, after the place of the start, whose gap has an
  // acceleration (m/s^2); `otherwise` (s) if it does not in the step. Elsewhere it does work on
  // what the turn of its geometry adds to the rate.
  double time(const ContactInput& contact, double frequency, double acceleration,
              double otherwise) const;
  // Whether a contact that changes its gap at `rate` (m/s) in the geometry of its hit, and by
  // `acceleration` (m/s^2) as that turns, does so for this turn: what rolls closes all gaps by
  // turning, and is no hit.
  bool rolls(const ContactInput& contact, double frequency, double rate, double acceleration) const;

 private:
  double onset(double gap, double closing, double acceleration) const;

  const ContactMotion& motion_;
  const TurningStep& step_;
  const IsolatedPairs& pairs_;
};

}  // namespace dashpot::host
