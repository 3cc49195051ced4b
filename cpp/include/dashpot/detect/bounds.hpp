// Boxes that bound geoms.

#pragma once

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// A box that bounds a geom, along its own axes: by its size, which may be edited alone, or as
// MuJoCo has it for meshes and height fields. Planes have none.
struct BoundingBox {
  double centre[3];    // world, m
  double half[3];      // half-widths, m
  double rotation[9];  // row-major; columns: the axes in the world
};
BoundingBox bounding_box(const mjModel_* m, const mjData_* d, int geom);

// Height (m) of the lowest point of a box over a plane geom.
double height_over_plane(const mjData_* d, int plane, const BoundingBox& box);

// The widest gap (m) that a face of either box leaves, negative where none does: a lower bound on
// the distance of what they bound.
double boxes_apart(const BoundingBox& box1, const BoundingBox& box2);

}  // namespace dashpot::host
