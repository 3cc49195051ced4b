// Contacts of two geoms that come to overlap within a step.
//
// MuJoCo finds the nearest points and, of shapes that face each other, others at about the same
// distance. Of a body that turns fast another one may come faster. Where geoms move far in a step,
// points that overlap at its end, at the velocities of its start, are contacts too, with the gap
// that they have now.

#pragma once

#include "dashpot/detection/moved_geom.hpp"

namespace dashpot::host {

// While it lives, two geoms are where they are at the end of the step, at the velocities of its
// start or those that its impacts are known to lead to: `body_velocity` (6 by body, as in cvel),
// null for the first.
class ComingContacts {
 public:
  ComingContacts(const mjModel* m, mjData* d, int geom1, int geom2, const mjtNum* body_velocity);

  // Adds, of the `end_count` contacts that collision finds there, those that are apart at the
  // start, within `margin` (m), to the `count` (at least 1) that it finds at the start, where none
  // of these stands for them, up to `most`; returns how many there are then.
  int add(const mjPreContact* end, int end_count, mjtNum margin, int most, mjPreContact* contact,
          int count) const;

 private:
  mjtNum gap_at_end(const mjPreContact& contact) const;

  mjtNum along_round_;  // m
  MovedGeom moved1_, moved2_;
};

}  // namespace dashpot::host
