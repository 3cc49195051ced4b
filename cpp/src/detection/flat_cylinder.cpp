#include "dashpot/detection/flat_cylinder.hpp"

#include <mujoco/mujoco.h>

#include <cmath>

namespace dashpot::host {

namespace {

// Tilt (rad) below which a cylinder stands flat on a plane. MuJoCo's distances are good to 1e-9
// radii above it.
constexpr double kFlatTilt = 1e-6;
const double kThirdTurn[2] = {-0.5, std::sqrt(0.75)};  // cosine and sine

// A column of a rotation matrix.
void column_of(const mjtNum* rotation, int column, mjtNum* out) {
  for (int i = 0; i < 3; ++i) out[i] = rotation[3 * i + column];
}

}  // namespace

bool stands_flat(const mjData_* d, int plane, int cylinder) {
  mjtNum normal[3], axis[3], tilt[3];
  column_of(d->geom_xmat + 9 * plane, 2, normal);
  column_of(d->geom_xmat + 9 * cylinder, 2, axis);
  mju_cross(tilt, axis, normal);
  return mju_norm3(tilt) < kFlatTilt;
}

int touch_with_cap(const mjModel_* m, const mjData_* d, int plane, int cylinder, double margin,
                   mjPreContact_* contact) {
  const mjtNum* rotation = d->geom_xmat + 9 * cylinder;
  const mjtNum radius = m->geom_size[3 * cylinder], half_length = m->geom_size[3 * cylinder + 1];
  mjtNum normal[3], axis[3], centre[3];
  column_of(d->geom_xmat + 9 * plane, 2, normal);
  column_of(rotation, 2, axis);
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

}  // namespace dashpot::host
