// The hits of two geoms: which of their contacts are hit in a step, and when the force of that acts
// (rows/hit.hpp).
//
// A hit is known of two bodies that hit each other alone (detect/isolated_pairs.hpp). Of most it
// counts where it is over within the step: what lasts longer goes by the geometry of every step.
// The normal of two round bodies turns on all the while, v_t / (r_1 + r_2), and a step in which the
// hit begins or ends has its force at one end: theirs are followed however long they last, if they
// are of SI stiffness.

#pragma once

#include "contact_motion.hpp"
#include "dashpot/detect/turning_step.hpp"
#include "dashpot/rows/rows.hpp"
#include "isolated_pairs.hpp"

namespace dashpot::host {

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
  // What the spring of such a contact of two round bodies, hit in the last step, is compressed by
  // (m); else 0.
  double compression(const ContactInput& contact) const;
  // When the gap of a contact closes at the rate that it has: 0 if it is closed, the length of the
  // step if it is not within it.
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
