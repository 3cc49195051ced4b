#include "dashpot/detection/moved_geom.hpp"

#include "dashpot/detection/side_by_side.hpp"
#include "dashpot/mujoco/mocap_bodies.hpp"
#include "dashpot/mujoco/velocities.hpp"

namespace dashpot::host {

void velocity_at(const mjModel* m, const mjData* d, int body, const mjtNum* point, mjtNum* angular,
                 mjtNum* linear) {
  point_velocity(m, d, body, point, linear);
  mju_copy3(angular, d->cvel + 6 * body);
  const mjtNum* carrier = is_fixed(m, body) ? nullptr : mocap_twist(m, d, body);
  if (carrier) mju_addTo3(angular, carrier);
}

MovedGeom::MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time, Spin spin,
                     const mjtNum* body_velocity)
    : position_(d->geom_xpos + 3 * geom), rotation_(d->geom_xmat + 9 * geom) {
  mju_copy3(start_position_, position_);
  mju_copy(start_rotation_, rotation_, 9);
  mjtNum linear[3], quaternion[4], angle[3];
  const int body = m->geom_bodyid[geom];
  if (body_velocity) {
    velocity_of_point(m, d, body, body_velocity + 6 * body, position_, linear);
    mju_copy3(angle, body_velocity + 6 * body);
  } else {
    velocity_at(m, d, body, position_, angle, linear);
  }
  if (spin == Spin::kOfShape && has_round_side(m->geom_type[geom])) {
    const mjtNum axis[3] = {rotation_[2], rotation_[5], rotation_[8]};
    mju_addToScl3(angle, axis, -mju_dot3(angle, axis));
  }
  mju_addToScl3(position_, linear, time);
  mju_scl3(angle, angle, time);
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
