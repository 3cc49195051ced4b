// A geom where its velocity takes it.

#pragma once

#include <mujoco/mujoco.h>

namespace dashpot::host {

// Velocity of a body at a point (world): also that of mocap bodies and of what hangs on them, which
// mj_objectVelocity leaves out.
void velocity_at(const mjModel* m, const mjData* d, int body, const mjtNum* point, mjtNum* angular,
                 mjtNum* linear);

// While it lives, the geom is where it will be after `time` (s) at the velocity that it has now.
class MovedGeom {
 public:
  MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time);
  ~MovedGeom();
  MovedGeom(const MovedGeom&) = delete;
  MovedGeom& operator=(const MovedGeom&) = delete;

 private:
  mjtNum* position_;
  mjtNum* rotation_;
  mjtNum start_position_[3], start_rotation_[9];
};

}  // namespace dashpot::host
