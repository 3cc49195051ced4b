// The load at which a model's own solref is read (solref.hpp): one spring and damper are right for
// one load; and its damper where a body is pressed between others.
//
// A new contact has that of its lighter part's weight. Once it has been still for longer than hits
// last, its load L (m/s^2, A F) follows the force F that it bears,
//
//     L' = (A F - L) / tau ,
//
// so that feet that share a weight, and parts that are gripped with many times theirs, give way as
// far as in MuJoCo, and a hit has the damping ratio of solref. The spring is that of L; the damper
// at most that of the weight, for the damper that solref asks for beside a stiffer spring is one
// that micro-steps seldom resolve. In the first step of all L is that under which the overlap
// rests, as far as the weight. What comes so fast that its weight would not stop it within the sag
// finds the spring of the weight.
//
// Limits and equalities go by their position x, as in MuJoCo: those of a connect or weld by the
// norm of all. Over a step their spring is linear. It has the load kappa(x) x of its start, and the
// slope of the chord to where its rate leads:
//
//     k = (load(x_1) - load(x_0)) (x_1 - x_0) / (x_1 - x_0)^2 ,
//
// What it takes on the way out it gives back on the way in. Where steps do not resolve how it grows
// stiffer, it gives back no more than it took (rows/recall.cpp). A limit may open within the
// step, and metres and radians of a weld have no potential together: these are no softer than what
// gives back all that is stored. One that grows stiffer by less than MuJoCo's default does is even:
// it has the impedance of its full width.

#pragma once

#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Reads the solref of contacts that are remembered, of limits and of equalities anew. `velocity`:
// per motion coordinate, at the start of the step. Returns whether any contact follows the solref
// of the model.
bool read_solref_at_load(const StepView& step, const AlignedDoubles& velocity, Rows& rows,
                         std::vector<GroupMaterial>& materials);

// What a model's own solref means where a body is pressed between others.
//
// A motion of the mass M that loads one of MuJoCo's rows (solref.hpp) has, with the inertia 1/R
// that the row adds, the damping ratio b / (2 sqrt(d k (1 + M R))). A spring kappa = d k / R, which
// leaves that inertia out, gives it the same ratio with the damper
//
//     b / sqrt(R (R + 1/M)) ,
//
// which for a body alone, 1/M = A, is delta of solref.hpp, and for a heavy motion b / R, MuJoCo's
// own. How heavy the motion is, a contact's own inverse mass w says, the sum of what either side
// adds, unless a body is pressed between others, as in a gripper: of what presses it, or presses it
// on against something else, the body itself is no part. Such a side adds nothing to 1/M.
//
// Sets the damping of contacts of bodies pressed between others that follow the model's own solref.
void damp_clamped_bodies(const mjModel_* model, const std::vector<ContactInput>& contacts,
                         const Rows& rows, std::vector<GroupMaterial>& materials);

}  // namespace dashpot
