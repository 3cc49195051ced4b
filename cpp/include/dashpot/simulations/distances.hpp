// Signed distance and time of impact of two geoms, as data have them and at many configurations on
// threads. Part of the MuJoCo host.

#pragma once

#include <vector>

#include "dashpot/geometry/query.hpp"
#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/threads/parallel.hpp"

namespace dashpot {

// The signed distance of two geoms where the kinematics of `data` last left them. Throws
// std::invalid_argument as distance(), geom_shape() and geom_pose() do.
Distance geom_distance(const mjModel_* model, const mjData_* data, int geom1, int geom2);

// Their first contact within `horizon` (s) along their velocities there. Throws
// std::invalid_argument as time_of_impact() and geom_motion() do, and UndecidedImpact naming them.
TimeOfImpact geom_time_of_impact(const mjModel_* model, const mjData_* data, int geom1, int geom2,
                                 double horizon);

// The signed distance of two geoms for each of `count` configurations, rows of `qpos` (count, nq).
// Bodies moved by mocap are where the model has them. Every entry depends on its row alone, so
// results are the same bit for bit for every number of threads; `nthread` 0: one per core.
// Throws std::invalid_argument as distance() and geom_shape() do, and what `interrupt` throws,
// which is asked between configurations.
std::vector<Distance> geom_distances(const mjModel_* model, int geom1, int geom2,
                                     const double* qpos, int count, int nthread,
                                     const Interrupt& interrupt = {});

// The first contact of two geoms for each of `count` states, rows of `qpos` (count, nq) and `qvel`
// (count, nv), along its velocities. Otherwise as geom_distances. Throws std::invalid_argument as
// time_of_impact() and geom_shape() do, and UndecidedImpact naming the geoms.
std::vector<TimeOfImpact> geom_times_of_impact(const mjModel_* model, int geom1, int geom2,
                                               const double* qpos, const double* qvel, int count,
                                               double horizon, int nthread,
                                               const Interrupt& interrupt = {});

}  // namespace dashpot
