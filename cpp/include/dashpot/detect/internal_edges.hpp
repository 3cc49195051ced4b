// Contacts at the internal edges between geoms.
//
// A body that slides from one tile of a floor to the next is pressed into the first a hair's
// breadth deeper than the edge of the second begins, and detection ahead finds its front about to
// run into the second one's side. So where a geom's body touches something along the normal m
// (into it), s deep or -s above it, or may in the step, a contact of the geom with another one that
// has a face along m, or lies beneath the plane of what it touches, as the next of a row of
// capsules that are a rail, is left out, unless its normal is m, while both overlap along m by no
// more than the body is pressed in, or keep apart as far:
//
//     o = max of m x over the other - min of m x over the geom,
//     o + H max(0, rate at which o grows - rate at which s does) <= s + s+ / 2 + b + tolerance ,
//
// s+ = max(0, s): what it touches ends its fall. Of a face along m the height where the geom comes
// to it counts, not that of its far end. b is the sag of a tile that is a body itself: how deep it
// is pressed into what bears it, and that into the next. What the other one continues is not seen
// in the middle of the step past its end (detect/pair_ahead.hpp).
//
// What rolls over an internal edge is for a while in touch with the face of one tile and the edge
// of the other, in one place: two springs, of which the one ahead begins without compression. Of
// balls, ellipsoids, capsules and cylinders, and tiles that are geoms of one body, only the deeper
// contact stays, and remembers what the other does (ContactInput::ghosts), unless the other
// face lies beneath: a core bears what is pressed through a skin.

#pragma once

#include <vector>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/supports.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

// Kept from step to step: a step allocates nothing.
struct InternalEdgeBuffers {
  SupportBuffers supports;
  std::vector<char> at_internal_edge;  // by contact
  std::vector<int> successor;          // by contact of a pair
};

// Drops the first kind of contacts of geoms that come nearer, and the second kind of all.
// `start_reach` (m): how far each geom can move in the step with the velocities of its start.
void drop_ghost_contacts(const mjModel_* m, const mjData_* d,
                         const std::vector<double>& start_reach, FaceBuffers& faces,
                         InternalEdgeBuffers& buffers, std::vector<ContactInput>& contacts);

}  // namespace dashpot::host
