// What a geom may collide with. Part of the mujoco_host room.

#pragma once

#include <functional>
#include <vector>

#include "dashpot/mujoco_reach.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// A lower bound of the distance (m) of two geoms, from their spheres and boxes of bounds.
double bounds_apart(const mjModel_* m, const mjData_* d, int geom1, int geom2);

// Calls visit(other, margin) for every geom that MuJoCo lets collide with `geom`; `margin` is the
// distance (m) at which contact starts. Filters that callbacks add are not asked.
void for_each_partner(const mjModel_* m, int geom,
                      const std::function<void(int other, double margin)>& visit);

// Whether motion at `mean_velocity` (nv) over `length` (s) takes a hinge or slide joint beyond a
// limit that is out of the reach of detection, which is widened then.
bool comes_to_limit(const mjModel_* m, const mjData_* d, const std::vector<double>& mean_velocity,
                    double length, ReachBuffers& reach);

}  // namespace dashpot::host
