// Pairs of geoms that go on far in a step, and whether a contact in the middle is one of the start.
//
// What goes on far may be past an edge by then: a ball that slides off a tile meets its edge in the
// middle, though it is on the next tile. A contact between round surfaces goes on, since these have
// no edges. So does one where nothing else touches the two: past an edge they fall. All others keep
// the geometry of the start. So do blows, which are over or to come by then.

#pragma once

#include "contact_motion.hpp"
#include "dashpot/rows/rows.hpp"
#include "isolated_pairs.hpp"
#include "seen_contacts.hpp"

namespace dashpot::host {

class FarPair {
 public:
  explicit FarPair(const ContactMotion& motion) : motion_(motion) {}

  // Of a pair whose first contact at the start is `contact`. False: it goes far, and its contacts
  // keep the geometry of the start.
  bool find(const mjData* d, const ContactInput& contact);

  // Whether a contact that is seen in the middle of a step of `length` (s) may be one of the start.
  bool follows(const mjData* d, const ContactInput& start, const SeenContact& seen,
               const IsolatedPairs& pairs, double length) const;

 private:
  bool runs_along(const ContactInput& contact) const;
  bool touches_round(const mjtNum* local_normal1, const mjtNum* local_normal2) const;
  // Whether a contact is seen past the end of a surface that another geom continues.
  bool is_past_end(const mjData* d, const ContactInput& start, const SeenContact& seen) const;

  const ContactMotion& motion_;
  bool is_far_ = false, on_round_ = false;
  double size_ = 0.0;  // m, radius about the smaller geom
};

}  // namespace dashpot::host
