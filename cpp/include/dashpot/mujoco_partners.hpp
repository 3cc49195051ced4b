// What a geom may collide with. Part of the mujoco_host room.

#pragma once

#include <vector>

#include "dashpot/mujoco_reach.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// A lower bound of the distance (m) of two geoms, from their spheres and boxes of bounds.
double bounds_apart(const mjModel_* m, const mjData_* d, int geom1, int geom2);

// A geom, and the distance (m) at which contact with it starts.
struct Partner {
  int geom = -1;
  double margin = 0.0;
};
// All that MuJoCo lets collide with `geom`. Filters that callbacks add are not asked.
void find_partners(const mjModel_* m, int geom, std::vector<Partner>& partners);

// Whether motion at `mean_velocity` (nv) over `length` (s) takes a hinge or slide joint beyond a
// limit that is out of the reach of detection, which is widened then.
bool comes_to_limit(const mjModel_* m, const mjData_* d, const std::vector<double>& mean_velocity,
                    double length, ReachBuffers& reach);

}  // namespace dashpot::host
