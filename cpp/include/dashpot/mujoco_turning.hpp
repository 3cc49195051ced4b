// Contacts of free bodies that turn, frozen in the middle of a step. Part of the mujoco_host room.
//
// Rows freeze the geometry over a step of length H. Frozen at its start, the force does not follow
// the contact as it moves on, and the gap misses what curves it, g'' H^2 / 2, which recovery of
// overlap then pays for: a motion x'' = -W^2 x that contact makes, as that of a tumbler, gains
// energy at the rate W^2 H / 2, and a coin on its edge spins up. Frozen where the velocities of the
// start bring the bodies in the middle, the errors before and after it cancel: neither gains.
//
// Collision of the pair alone is asked again, with its geoms in the poses of the middle. Gaps stay
// those of the start: from there the rates in the middle lead to those of the end. Rates and slip
// in the middle are not those of the start and the end: what their change, dJ/dt xi, adds is
// ContactInput::turning, without which dampers would take from every turn what the next step finds.

#pragma once

#include <vector>

#include "dashpot/rows.hpp"
#include "dashpot/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct FaceBuffers;

// Takes contacts of free bodies that touch and turn to the middle of a step of `length` (s): their
// frames, also in `d`, and where they act on each body, seen from where its centre of mass is at
// the start. `motion`: velocities in motion coordinates. `may_turn`, by tree: a free body that may
// be taken there; `turned`, zeros before: one that was. `faces` are kept from step to step.
// Contacts without a counterpart in the middle stay as they are, and so do those with moving links,
// whose rows are frozen at the start.
void take_to_middle(const mjModel_* m, mjData_* d, double length, const Trees& trees,
                    const double* motion, const std::vector<char>& may_turn, FaceBuffers& faces,
                    std::vector<ContactInput>& contacts, std::vector<char>& turned);

}  // namespace dashpot::host
