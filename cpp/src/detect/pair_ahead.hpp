// A pair of geoms at a time within a step, and what contacts of its start are then.
//
// Collision of the pair alone is asked again with the geoms where the velocities of the start bring
// them in the time t. A contact that is found then has the acceleration of its gap and of sliding
//
//     dJ/dt xi = (u(t) - u(0)) / t ,
//
// u: rate of the two points that touch, by the velocities of the start. Each free body sees the
// point from where its centre of mass is at the start; axes of joints and twists go to that time
// themselves.

#pragma once

#include <mujoco/mujoco.h>

#include "contact_motion.hpp"
#include "dashpot/rows/rows.hpp"
#include "far_pair.hpp"
#include "isolated_pairs.hpp"
#include "seen_contacts.hpp"

namespace dashpot::host {

struct FaceBuffers;

class PairAhead {
 public:
  // Of the contacts from `first` to `last`, of geoms that move as `motion` has it, in a step of
  // `length` (s).
  PairAhead(mjModel* m, mjData* d, ContactMotion& motion, const FarPair& far,
            const IsolatedPairs& pairs, double length, ContactInput* first, ContactInput* last)
      : model_(m),
        data_(d),
        motion_(motion),
        far_(far),
        pairs_(pairs),
        length_(length),
        first_(first),
        last_(last),
        seen_(motion, length) {}

  // Collides the geoms where they are after a time (s), out to `apart` (m) beyond how far they move
  // up to then.
  void look(double time, FaceBuffers& faces, double apart = 0.0);
  // That time, 0 before.
  double time() const { return time_; }

  // What a contact is then, null if it is not there. `is_round_hit`: of two round bodies that hit
  // each other alone, which may go far, but turn evenly.
  ContactInput* find(const ContactInput& contact, bool is_round_hit);
  // The same of one that comes on, wherever it goes, with its gap (m) then.
  ContactInput* find_coming(const ContactInput& contact);

 private:
  const SeenContact* continuation(const ContactInput& contact) const;
  // The geometry that a contact has as it is seen after a time (s).
  ContactInput seen_in(const SeenContact& seen, double time, ContactInput contact) const;
  // Gives a contact that was at `start` what turns it.
  void find_turning(const ContactInput& start, ContactInput& contact) const;

  mjModel* model_;
  mjData* data_;
  ContactMotion& motion_;
  const FarPair& far_;
  const IsolatedPairs& pairs_;
  double length_;
  ContactInput *first_, *last_;
  double time_ = 0.0, way_ = 0.0;  // s, and how far (m) the pair moves up to then
  SeenContacts seen_;
  ContactInput then_;
};

}  // namespace dashpot::host
