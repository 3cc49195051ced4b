// Queries against height fields: the nearest, or the deepest, of their prisms.
//
// A height field is the union of its prisms. Apart from it, the signed distance is that of the
// nearest prism. In overlap it is that of the prism which is deepest in the other shape: the length
// of the shortest translation that parts the two, and so a lower bound of the translation that
// clears the whole solid. Both are the least signed distance over all prisms.
//
// For every unit direction the gap along it bounds a prism's signed distance from below (see
// convex_distance.hpp). Such bounds, along the axes of the field and along the normals of prisms
// measured before, leave only few prisms to be measured.

#pragma once

#include <Eigen/Geometry>

#include "dashpot/geometry/query.hpp"

namespace dashpot {

// The bounding box (m, world) of a shape that has a core, and one wider by so much (m) all around.
Eigen::AlignedBox3d bounding_box(const Shape& shape, const Pose& pose);
Eigen::AlignedBox3d inflated(Eigen::AlignedBox3d box, double by);

// The bounding box (m) of a height field in its own frame. Leaves out heights that are not finite.
Eigen::AlignedBox3d height_field_box(const HeightField& field);

// The convex hull of the solid, which is all that a plane sees of it. Throws std::invalid_argument
// naming a height that is not finite.
Shape height_field_hull(const HeightField& field);

// Signed distance from a height field (shape 1) to a bounded convex shape (shape 2). Reads the
// heights near the shape. Throws std::invalid_argument naming one that is not finite.
Distance height_field_distance(const HeightField& field, const Pose& field_pose, const Shape& shape,
                               const Pose& pose);

// First contact of a moving height field (shape 1) with a moving bounded convex shape (shape 2), as
// time_of_impact() has it: that of the first prism to be touched. Time is divided into windows in
// which the shape moves by about its own size, or that of a cell, and turns little; only prisms
// that its bounding box sweeps there are examined.
TimeOfImpact height_field_time_of_impact(const HeightField& field, const Pose& field_pose,
                                         const Motion& field_motion, const Shape& shape,
                                         const Pose& pose, const Motion& motion, double horizon,
                                         double margin);

}  // namespace dashpot
