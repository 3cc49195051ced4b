// How far contacts and limits may be at the start of a step to start in it.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/collisions.hpp"

namespace dashpot::host {

class Narrowing;

// What a model sets itself, and what the reach is computed from; kept from step to step.
struct ReachBuffers {
  std::vector<double> geom_gap, body_margin, pair_gap, flex_gap, joint_margin, tendon_margin;
  std::vector<double> now, later;           // spatial velocities of bodies at both ends of the step
  std::vector<double> end_velocity, reach;  // generalized; by geom, m
  std::vector<double> start_reach;          // by geom, m: with the velocities of the start alone
  std::vector<double> dof_reach;            // by degree of freedom, m or rad
  // What reach covers at least: where rows take geoms and joints, see impact_propagation.hpp.
  std::vector<double> least_reach, least_dof_reach;
  // Nothing, but joints as far as they went last (nv, or null): rows may throw them back.
  void start(const mjModel_* m, const double* last_displacement);
  // The gap (m) that the model gives two geoms itself, or the <pair> that defines them, if >= 0.
  double own_gap(const std::array<int, 2>& geom, int pair) const;
};

// Bound on the speed (m/s) of the points of a geom, of a plane as far as other geoms that move are
// from its centre, from the spatial velocities of all bodies.
double geom_speed(const mjModel_* m, const mjData_* d, int geom, const double* body_velocity);
// The same of the points of either geom against the other, which is that of the points where they
// are nearest along their normal; infinity where neither has bounds.
double relative_speed(const mjModel_* m, const mjData_* d, int geom1, int geom2,
                      const double* body_velocity);
// Whether a geom takes part in collisions, and a joint or a mocap body moves it.
bool moves_and_collides(const mjModel_* m, int geom);

// While it lives, collisions are replaced, within the distance that `narrowing` says if it is
// there, and the detection distance of every geom, pair, flex, joint and tendon covers how far it
// can move in the model's time step with `acceleration` (nv), the smooth one. Without that (null)
// distances stay the model's own.
class WidenedReach {
 public:
  WidenedReach(mjModel_* m, const mjData_* d, const std::vector<double>* acceleration,
               FaceBuffers* faces, Narrowing* narrowing, ReachBuffers& buffers);
  ~WidenedReach();
  WidenedReach(const WidenedReach&) = delete;
  WidenedReach& operator=(const WidenedReach&) = delete;

  // Whether MuJoCo would have found a contact without the wider reach.
  bool within_own(const mjContact_& contact) const;

 private:
  ReplacedCollisions collisions_;
  mjModel_* m_;
  ReachBuffers& buffers_;
};

}  // namespace dashpot::host
