#include "moved_geom.hpp"

#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

void velocity_at(const mjModel* m, const mjData* d, int body, const mjtNum* point, mjtNum* angular,
                 mjtNum* linear) {
  point_velocity(m, d, body, point, linear);
  mju_copy3(angular, d->cvel + 6 * body);
  const mjtNum* carrier = is_fixed(m, body) ? nullptr : mocap_twist(m, d, body);
  if (carrier) mju_addTo3(angular, carrier);
}

MovedGeom::MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time)
    : position_(d->geom_xpos + 3 * geom), rotation_(d->geom_xmat + 9 * geom) {
  mju_copy3(start_position_, position_);
  mju_copy(start_rotation_, rotation_, 9);
  mjtNum linear[3], quaternion[4], angle[3], turn[9];
  velocity_at(m, d, m->geom_bodyid[geom], position_, angle, linear);
  mju_addToScl3(position_, linear, time);
  mju_scl3(angle, angle, time);
  const mjtNum norm = mju_normalize3(angle);
  mju_axisAngle2Quat(quaternion, angle, norm);
  mju_quat2Mat(turn, quaternion);
  mju_mulMatMat(rotation_, turn, start_rotation_, 3, 3, 3);
}

MovedGeom::~MovedGeom() {
  mju_copy3(position_, start_position_);
  mju_copy(rotation_, start_rotation_, 9);
}

}  // namespace dashpot::host
