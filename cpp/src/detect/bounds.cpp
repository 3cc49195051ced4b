#include "dashpot/detect/bounds.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

namespace dashpot::host {

namespace {

// Half-widths by the size of a geom about its centre; whether its type has them.
bool half_widths_of_size(const mjModel* m, int geom, double* half) {
  const mjtNum* size = m->geom_size + 3 * geom;
  const auto set = [&](double x, double y, double z) {
    half[0] = x;
    half[1] = y;
    half[2] = z;
    return true;
  };
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
      return set(size[0], size[0], size[0]);
    case mjGEOM_CAPSULE:
      return set(size[0], size[0], size[1] + size[0]);
    case mjGEOM_CYLINDER:
      return set(size[0], size[0], size[1]);
    case mjGEOM_ELLIPSOID:
    case mjGEOM_BOX:
      return set(size[0], size[1], size[2]);
    default:
      return false;
  }
}

// Half-width (m) of a box along a unit vector of the world.
double half_width_along(const BoundingBox& box, const double* direction) {
  mjtNum along[3];
  mju_mulMatTVec3(along, box.rotation, direction);
  return box.half[0] * std::abs(along[0]) + box.half[1] * std::abs(along[1]) +
         box.half[2] * std::abs(along[2]);
}

}  // namespace

BoundingBox bounding_box(const mjModel_* m, const mjData_* d, int geom) {
  BoundingBox box;
  std::copy_n(d->geom_xmat + 9 * geom, 9, box.rotation);
  if (half_widths_of_size(m, geom, box.half)) {
    mju_copy3(box.centre, d->geom_xpos + 3 * geom);
    return box;
  }
  const mjtNum* bounds = m->geom_aabb + 6 * geom;
  mju_mulMatVec3(box.centre, box.rotation, bounds);
  mju_addTo3(box.centre, d->geom_xpos + 3 * geom);
  mju_copy3(box.half, bounds + 3);
  return box;
}

double height_over_plane(const mjData_* d, int plane, const BoundingBox& box) {
  const mjtNum* rotation = d->geom_xmat + 9 * plane;
  const mjtNum normal[3] = {rotation[2], rotation[5], rotation[8]};
  mjtNum apart[3];
  mju_sub3(apart, box.centre, d->geom_xpos + 3 * plane);
  return mju_dot3(apart, normal) - half_width_along(box, normal);
}

double boxes_apart(const BoundingBox& box1, const BoundingBox& box2) {
  mjtNum between[3], along1[3], along2[3];
  mju_sub3(between, box2.centre, box1.centre);
  mju_mulMatTVec3(along1, box1.rotation, between);
  mju_mulMatTVec3(along2, box2.rotation, between);
  double gap1[3], gap2[3];  // along the faces of the first and of the second
  for (int i = 0; i < 3; ++i) {
    gap1[i] = std::abs(along1[i]) - box1.half[i];
    gap2[i] = std::abs(along2[i]) - box2.half[i];
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double cosine = 0.0;
      for (int k = 0; k < 3; ++k) cosine += box1.rotation[3 * k + i] * box2.rotation[3 * k + j];
      cosine = std::abs(cosine);
      gap1[i] -= cosine * box2.half[j];
      gap2[j] -= cosine * box1.half[i];
    }
  return std::max({gap1[0], gap1[1], gap1[2], gap2[0], gap2[1], gap2[2]});
}

}  // namespace dashpot::host
