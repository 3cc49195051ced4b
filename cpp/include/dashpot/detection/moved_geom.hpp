// A geom where its velocity takes it.

#pragma once

#include <mujoco/mujoco.h>

namespace dashpot::host {

// Velocity of a body at a point (world): also that of mocap bodies and of what hangs on them, which
// mj_objectVelocity leaves out.
void velocity_at(const mjModel* m, const mjData* d, int body, const mjtNum* point, mjtNum* angular,
                 mjtNum* linear);

// What to follow of a capsule or a cylinder that turns about its axis: its points, or its shape,
// which does not turn.
enum class Spin { kOfPoints, kOfShape };

// While it lives, the geom is where it will be after `time` (s) at the velocity that it has now, or
// at that of `body_velocity`, where not null: by body, rotation and translation about the centre of
// mass of its tree, as in cvel, with that of mocap bodies in what hangs on them.
class MovedGeom {
 public:
  MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time, Spin spin = Spin::kOfPoints,
            const mjtNum* body_velocity = nullptr);
  ~MovedGeom();
  MovedGeom(const MovedGeom&) = delete;
  MovedGeom& operator=(const MovedGeom&) = delete;
  // Where a point that moves with the geom, or with its shape, is now, given where it will be.
  void move_back(mjtNum* point) const;
  // Where it will be, given where it is now.
  void move_on(mjtNum* point) const;

 private:
  mjtNum* position_;
  mjtNum* rotation_;
  mjtNum start_position_[3], start_rotation_[9], turn_[9];
};

}  // namespace dashpot::host
