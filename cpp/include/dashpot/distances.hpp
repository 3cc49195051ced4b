// Signed distance and time of impact of two geoms at many configurations, on threads. Part of the
// MuJoCo host.

#pragma once

#include <vector>

#include "dashpot/query.hpp"

struct mjModel_;

namespace dashpot {

// The signed distance of two geoms for each of `count` configurations, rows of `qpos` (count, nq).
// Bodies moved by mocap are where the model has them. Every entry depends on its row alone, so
// results are the same bit for bit for every number of threads; `nthread` 0: one per core.
// Throws std::invalid_argument as distance() and geom_shape() do.
std::vector<Distance> geom_distances(const mjModel_* model, int geom1, int geom2,
                                     const double* qpos, int count, int nthread);

// The first contact of two geoms for each of `count` states, rows of `qpos` (count, nq) and `qvel`
// (count, nv), along the velocities of that state. Otherwise as geom_distances. Throws
// std::invalid_argument as time_of_impact() and geom_shape() do.
std::vector<TimeOfImpact> geom_times_of_impact(const mjModel_* model, int geom1, int geom2,
                                               const double* qpos, const double* qvel, int count,
                                               double horizon, int nthread);

}  // namespace dashpot
