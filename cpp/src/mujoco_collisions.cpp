#include "dashpot/mujoco_collisions.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

// Exported by the pinned MuJoCo library though not declared in its public headers: the collision of
// any two convex geoms.
extern "C" int mjc_Convex(const mjModel* m, mjData* d, mjPreContact* con, int g1, int g2,
                          mjtNum margin);

namespace dashpot::host {

namespace {

// Part of a box's least half-width: a wider reach needs contacts of boxes that meet at a corner.
constexpr double kFarReach = 0.005;
// Tilt (rad) below which a cylinder stands flat on a plane. MuJoCo's distances are good to 1e-9
// radii above it.
constexpr double kFlat = 1e-6;
const double kThirdTurn[2] = {-0.5, std::sqrt(0.75)};  // cosine and sine

thread_local bool replaced = false;
mjfCollision collide_boxes = nullptr, collide_cylinder = nullptr;

int collide_boxes_apart(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                        mjtNum margin) {
  const int count = collide_boxes(m, d, contact, geom1, geom2, margin);
  if (count > 0 || !replaced) return count;
  double half_width = mjMAXVAL;
  for (int geom : {geom1, geom2})
    for (int i = 0; i < 3; ++i) half_width = std::min(half_width, m->geom_size[3 * geom + i]);
  if (margin <= kFarReach * half_width) return 0;
  return mjc_Convex(m, d, contact, geom1, geom2, margin);
}

// A column of a rotation matrix.
void column_of(const mjtNum* rotation, int column, mjtNum* out) {
  for (int i = 0; i < 3; ++i) out[i] = rotation[3 * i + column];
}

int collide_flat_cylinder(const mjModel* m, mjData* d, mjPreContact* contact, int plane,
                          int cylinder, mjtNum margin) {
  if (!replaced) return collide_cylinder(m, d, contact, plane, cylinder, margin);
  const mjtNum* rotation = d->geom_xmat + 9 * cylinder;
  const mjtNum radius = m->geom_size[3 * cylinder], half_length = m->geom_size[3 * cylinder + 1];
  mjtNum normal[3], axis[3], tilt[3], centre[3];
  column_of(d->geom_xmat + 9 * plane, 2, normal);
  column_of(rotation, 2, axis);
  mju_cross(tilt, axis, normal);
  if (mju_norm3(tilt) >= kFlat) return collide_cylinder(m, d, contact, plane, cylinder, margin);
  mju_sub3(centre, d->geom_xpos + 3 * cylinder, d->geom_xpos + 3 * plane);
  // The cap that faces the plane.
  const mjtNum to_cap = mju_dot3(axis, normal) > 0 ? -half_length : half_length;
  int count = 0;
  for (int point = 0; point < 3; ++point) {
    mjtNum arm[3], position[3];
    const mjtNum cosine = point == 0 ? 1.0 : kThirdTurn[0];
    const mjtNum sine = point == 0 ? 0.0 : (point == 1 ? kThirdTurn[1] : -kThirdTurn[1]);
    for (int i = 0; i < 3; ++i)
      arm[i] = to_cap * axis[i] + radius * (cosine * rotation[3 * i] + sine * rotation[3 * i + 1]);
    mju_add3(position, centre, arm);
    const mjtNum distance = mju_dot3(position, normal);
    if (distance > margin) continue;
    mjPreContact& c = contact[count++];
    c.dist = distance;
    mju_add3(c.pos, d->geom_xpos + 3 * cylinder, arm);
    mju_addToScl3(c.pos, normal, -0.5 * distance);
    mju_copy3(c.normal, normal);
    mju_zero3(c.tangent);
  }
  return count;
}

// Once in a process.
void install() {
  static const bool installed = [] {
    mjfCollision& boxes = mjCOLLISIONFUNC[mjGEOM_BOX][mjGEOM_BOX];
    collide_boxes = boxes;
    boxes = collide_boxes_apart;
    mjfCollision& standing = mjCOLLISIONFUNC[mjGEOM_PLANE][mjGEOM_CYLINDER];
    collide_cylinder = standing;
    standing = collide_flat_cylinder;
    return true;
  }();
  static_cast<void>(installed);
}

}  // namespace

ReplacedCollisions::ReplacedCollisions() : outer_(replaced) {
  install();
  replaced = true;
}

ReplacedCollisions::~ReplacedCollisions() { replaced = outer_; }

}  // namespace dashpot::host
