#include "dashpot/mujoco_moved_geom.hpp"

namespace dashpot::host {

MovedGeom::MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time)
    : position_(d->geom_xpos + 3 * geom), rotation_(d->geom_xmat + 9 * geom) {
  mju_copy3(start_position_, position_);
  mju_copy(start_rotation_, rotation_, 9);
  mjtNum velocity[6], quaternion[4], angle[3];
  mj_objectVelocity(m, d, mjOBJ_GEOM, geom, velocity, 0);
  mju_addToScl3(position_, velocity + 3, time);
  mju_scl3(angle, velocity, time);
  const mjtNum norm = mju_normalize3(angle);
  mju_axisAngle2Quat(quaternion, angle, norm);
  mju_quat2Mat(turn_, quaternion);
  mju_mulMatMat(rotation_, turn_, start_rotation_, 3, 3, 3);
}

MovedGeom::~MovedGeom() {
  mju_copy3(position_, start_position_);
  mju_copy(rotation_, start_rotation_, 9);
}

void MovedGeom::move_back(mjtNum* point) const {
  mjtNum arm[3];
  mju_sub3(arm, point, position_);
  mju_mulMatTVec3(point, turn_, arm);
  mju_addTo3(point, start_position_);
}

void MovedGeom::move_on(mjtNum* point) const {
  mjtNum arm[3];
  mju_sub3(arm, point, start_position_);
  mju_mulMatVec3(point, turn_, arm);
  mju_addTo3(point, position_);
}

}  // namespace dashpot::host
