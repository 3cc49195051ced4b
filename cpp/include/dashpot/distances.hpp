// Signed distance of two geoms at many configurations, on threads. Part of the MuJoCo host.

#pragma once

#include <vector>

#include "dashpot/convex_distance.hpp"

struct mjModel_;

namespace dashpot {

// The signed distance of two geoms for each of `count` configurations, rows of `qpos` (count, nq).
// Bodies moved by mocap are where the model has them. Every entry depends on its row alone, so
// results are the same bit for bit for every number of threads; `nthread` 0: one per core.
// Throws std::invalid_argument as distance() and geom_shape() do.
std::vector<Distance> geom_distances(const mjModel_* model, int geom1, int geom2,
                                     const double* qpos, int count, int nthread);

}  // namespace dashpot
