// Contacts of bodies that turn, frozen in the middle of a step, or when the force of a hit acts.
//
// Rows freeze the geometry over a step of length H. Frozen at its start, the force does not follow
// the contact as it moves on, and the gap misses what curves it, g'' H^2 / 2, which recovery of
// overlap then pays for: a motion x'' = -W^2 x that contact makes, as that of a tumbler, gains
// energy at the rate W^2 H / 2, and a coin on its edge spins up. Frozen where the velocities of the
// start bring the bodies in the middle, the errors before and after it cancel: neither gains.
//
// Collision of the pair alone is asked again (pair_ahead.hpp), with its geoms in the poses of the
// middle. Gaps stay those of the start: from there the rates in the middle lead to those of the
// end. Rates and slip in the middle are not those of the start and the end: what their change,
// dJ/dt xi, adds is ContactInput::turning. Without it dampers would take energy from every turn.
//
// What is left out of the gap is of third order: with T = dJ/dt xi of the normal, which bodies that
// speed up change by dT/dt, the gap grows by
//
//     H^3 / 8 dT/dt
//
// more than the rates of the middle lead it. With what T changed by since the last step this goes
// along with the rates (RowData::drift); gap and overlap are then of fourth order.
//
// That holds for forces that last. What is hit, or flies off, in a fraction of the step is frozen
// where the force of that has its centre (hit.hpp), or it would do work on the turn before or
// after. That is known of two bodies that hit each other alone (detect/pair_hits.hpp). Of others
// a blow between round ones that begins or ends early keeps the geometry of the start.
//
// What is apart at the start and comes on is frozen where it is met: the plane through the nearest
// point of an edge ahead rises before what passes over it. As gaps of convex geoms that pass close
// ever slower, the planes at
//
//     t+ = t + g(t) / -g'(t)
//
// come to where they meet from below, or to where they pass.
//
// Of links the axes of the joints go to the middle (model/velocities.hpp), also where they turn
// above a foot that stands. Their inertia stays that of the start, where smooth forces are: the
// Verlet corrector of the step corrects both (trapezoid.hpp). So does that of free bodies that
// constraints hold, whose rows have the geometry of the start.

#pragma once

#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

// What is known of a step before its contacts are frozen.
struct TurningStep {
  double length;    // s
  bool any_motion;  // none is so small that it counts as rest, as where a step is differentiated
  const Trees& trees;
  const double* motion;           // velocities in motion coordinates
  const HitFrequency& frequency;  // of contacts that may be hit
  const Memory& memory;           // of what was hit in the last step
};

struct FaceBuffers;
class Scratch;

// Takes contacts of bodies that touch and turn to the middle of a step, or of the hit in it: their
// frames, also in `d`, and where they act on each body, for free bodies seen from where its centre
// of mass is at the start. Times of contacts are counted from the places of the start, which may
// lead. Contacts without a counterpart then stay as they are. `tree_ahead`, by tree, zeros before:
// to which time (s) contacts of it were taken, that of the middle where they differ.
void freeze_contacts(mjModel_* m, mjData_* d, const TurningStep& step, FaceBuffers& faces,
                     Scratch& scratch, std::vector<ContactInput>& contacts,
                     std::vector<double>& tree_ahead, Team& team);

}  // namespace dashpot::host
