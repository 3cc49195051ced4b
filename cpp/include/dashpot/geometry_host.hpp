// Shapes, poses and motions of the geoms of a MuJoCo model. Part of the MuJoCo host.

#pragma once

#include <vector>

#include "dashpot/closest.hpp"
#include "dashpot/shape.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

// Throws std::invalid_argument unless `data` was made from `model` or a copy of it.
void check_data_of(const mjModel_* model, const mjData_* data);

// The convex shape of a geom; a mesh gives its convex hull. `geom` in [0, ngeom).
// Throws std::invalid_argument naming the geom where it is a height field or a signed distance
// field, or has a bad size.
Shape geom_shape(const mjModel_* model, int geom);

// Its pose as the data's kinematics last left it (geom_xpos, geom_xmat), as mj_geomDistance has it.
// Throws std::invalid_argument naming the geom where the pose is not finite.
Pose geom_pose(const mjModel_* model, const mjData_* data, int geom);

// The velocity of its body, at the body's centre of mass, as the data's kinematics last left it
// (cvel). Throws std::invalid_argument naming the geom where it is not finite.
Motion geom_motion(const mjModel_* model, const mjData_* data, int geom);

// Every geom that takes part in collisions (contype or conaffinity set), in the order of their ids,
// grouped by the bodies they are welded to. `body` >= 0 marks the geoms of that body as of
// interest, -1 all. Throws as geom_shape and geom_pose do.
std::vector<PlacedShape> placed_shapes(const mjModel_* model, const mjData_* data, int body);

}  // namespace dashpot
