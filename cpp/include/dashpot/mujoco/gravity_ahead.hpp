// What weights change by, as generalized forces, while a tree moves on.
//
// The weight of all that a joint bears turns it by axis . W, with the axis and the wrench W about
// the centre of mass of the tree (mujoco/moved_axes.hpp). Both move:
//
//     change = axis(t) . W(t) - axis(0) . W(0) .

#pragma once

#include <vector>

#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

enum class Gravity { kLessCompensation, kOfCompensation };

// Adds the change (N or N m, nv) of a tree's weights less their gravity compensation, or of this,
// `time` (s) ahead of the start of the step, all going on at its velocities. `wrench` is room, kept
// from call to call.
void add_gravity_ahead(const mjModel_* m, const mjData_* d, int tree, double time, Gravity gravity,
                       std::vector<double>& wrench, double* change);

// Whether a body of a tree whose inverse inertia is known has a joint with t^2 m g l / 2 I of
// `least` or more, t: `time` (s): by how much gravity that lags by t / 2 turns a part, relative to
// what this has turned in t. m: mass of all that hangs on a joint, l: how far its centre is from
// that.
bool has_light_part(const mjModel_* m, const mjData_* d, const Trees& trees, int tree, double time,
                    double least);

}  // namespace dashpot::host
