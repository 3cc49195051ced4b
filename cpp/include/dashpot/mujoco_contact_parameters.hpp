// What an MJCF says about contacts of two geoms. Part of the mujoco_host room.

#pragma once

#include "dashpot/rows.hpp"

struct mjModel_;

namespace dashpot::host {

// A contact of two geoms of a model, with all that the model says about it and no geometry: what
// MuJoCo gives the contacts that it detects between them.
ContactInput contact_of_pair(const mjModel_* m, int geom1, int geom2);

}  // namespace dashpot::host
