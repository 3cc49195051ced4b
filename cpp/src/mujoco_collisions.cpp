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
// The same above which corners that are not nearest count: below, they go in by less in a step.
constexpr double kFastReach = 0.05;
constexpr int kMostOfBoxes = 8;  // contacts that MuJoCo takes from the collision of two boxes
// Cosine between the normals of a corner and of the contact found: convex bodies meet along one.
constexpr double kAlike = 0.85;
// Part of a half-width within which a corner is that of a contact known already.
constexpr double kSameCorner = 1e-3;
// Tilt (rad) below which a cylinder stands flat on a plane. MuJoCo's distances are good to 1e-9
// radii above it.
constexpr double kFlat = 1e-6;
const double kThirdTurn[2] = {-0.5, std::sqrt(0.75)};  // cosine and sine

thread_local bool replaced = false;
mjfCollision collide_boxes = nullptr, collide_cylinder = nullptr;

// A column of a rotation matrix.
void column_of(const mjtNum* rotation, int column, mjtNum* out) {
  for (int i = 0; i < 3; ++i) out[i] = rotation[3 * i + column];
}

bool is_known(const mjtNum* position, const mjPreContact* known, int count, mjtNum near) {
  return std::any_of(known, known + count, [&](const mjPreContact& contact) {
    return mju_dist3(position, contact.pos) < near;
  });
}

// Adds corners of box `cornered` that lie above a face of the other one, within `margin`, to the
// `count` contacts known; returns how many there are then. `sign` turns normals from geom1 to
// geom2: it is 1 if the corners are geom2's. Corners beyond the edges of all faces, which may pass,
// are left out.
int add_corners(const mjModel* m, const mjData* d, int cornered, int other, mjtNum margin,
                double sign, mjPreContact* contact, int count) {
  const mjtNum* size = m->geom_size + 3 * cornered;
  const mjtNum* other_size = m->geom_size + 3 * other;
  const mjtNum same = kSameCorner * std::min({size[0], size[1], size[2]});
  for (int index = 0; index < 8 && count < kMostOfBoxes; ++index) {
    mjtNum corner[3], local[3], arm[3];
    for (int i = 0; i < 3; ++i) local[i] = index >> i & 1 ? size[i] : -size[i];
    mju_mulMatVec3(corner, d->geom_xmat + 9 * cornered, local);
    mju_addTo3(corner, d->geom_xpos + 3 * cornered);
    mju_sub3(arm, corner, d->geom_xpos + 3 * other);
    mju_mulMatTVec3(local, d->geom_xmat + 9 * other, arm);
    int axis = -1, beyond = 0;
    for (int i = 0; i < 3; ++i)
      if (std::abs(local[i]) > other_size[i]) {
        axis = i;
        ++beyond;
      }
    if (beyond != 1) continue;
    mjPreContact& c = contact[count];
    c.dist = std::abs(local[axis]) - other_size[axis];
    if (c.dist > margin) continue;
    column_of(d->geom_xmat + 9 * other, axis, c.normal);
    if (local[axis] < 0) mju_scl3(c.normal, c.normal, -1.0);
    mju_addScl3(c.pos, corner, c.normal, -0.5 * c.dist);
    if (is_known(c.pos, contact, count, same)) continue;
    mju_scl3(c.normal, c.normal, sign);
    if (mju_dot3(c.normal, contact[0].normal) < kAlike) continue;
    mju_zero3(c.tangent);
    ++count;
  }
  return count;
}

int collide_moving_boxes(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                         mjtNum margin) {
  int count = collide_boxes(m, d, contact, geom1, geom2, margin);
  if (!replaced) return count;
  double half_width = mjMAXVAL;
  for (int geom : {geom1, geom2})
    for (int i = 0; i < 3; ++i) half_width = std::min(half_width, m->geom_size[3 * geom + i]);
  if (margin <= kFarReach * half_width) return count;
  if (count == 0) count = mjc_Convex(m, d, contact, geom1, geom2, margin);
  if (count == 0 || margin <= kFastReach * half_width) return count;
  count = add_corners(m, d, geom2, geom1, margin, 1.0, contact, count);
  return add_corners(m, d, geom1, geom2, margin, -1.0, contact, count);
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
    boxes = collide_moving_boxes;
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
