// Geoms where their velocities take them, and how two that touch move on each other within a step.

#pragma once

#include <mujoco/mujoco.h>

#include <array>

#include "dashpot/detect/turning.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

// Velocity of a body at a point (world), also of mocap bodies and of what hangs on them.
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

// Way in a step, relative to the size of the smaller geom, up to which a pair is at rest: what
// curves there is a height of 1e-10 of that size.
inline constexpr double kStillWay = 1e-5;

// The velocities that a pair of geoms has at the start of a step of `length` (s), and what they
// lead to. World frame, SI units.
class ContactMotion {
 public:
  ContactMotion(const mjModel* m, const mjData* d, double length)
      : model_(m), data_(d), length_(length) {}

  // Finds the motion of the geoms of a contact in a step. Returns false where contacts of one geom
  // do not follow its pose, as those of flexes and of signed distance fields.
  bool find(const ContactInput& contact, const TurningStep& step);

  // m/s^2; without any that on earth.
  double gravity() const;
  int geom(int side) const { return side_[side].geom; }
  int geom_type(int side) const { return model_->geom_type[side_[side].geom]; }
  // Whether the geom belongs to a free body.
  bool is_free(int side) const { return side_[side].is_free; }
  const mjtNum* angular(int side) const { return side_[side].angular; }
  // Velocity of the centre of mass of the body, with what is welded to it if it is free.
  const mjtNum* linear(int side) const { return side_[side].linear; }
  // Velocity of the centre of mass of the second body relative to that of the first.
  const mjtNum* relative() const { return relative_; }

  bool is_ball(int side) const;
  // Whether the geom is a ball about the centre of mass of a free body: the same however it turns.
  bool is_free_ball(int side) const;
  // Whether the normal turns wherever the two touch.
  bool are_round() const;
  // Whether both geoms touch in points that are fixed to them.
  bool have_corners() const;
  // Whether a geom is round along a unit direction of its own frame, as the side of a cylinder.
  bool is_round_along(int side, const mjtNum* local) const;
  // Radius (m) about the smaller geom; planes have none.
  double size() const;
  // Radius (m) of the thinner of round sides; of geoms with corners the least half-width.
  double thickness() const;

  // By how much (rad) the faster of the two turns in the step.
  double turn() const;
  // How far (m) the centre of the smaller geom moves on the body of the other in the step: not at
  // all where both turn as one, however far from each other the centres of mass of the bodies are.
  double way() const;
  // The farthest (m) that any two points of the geoms move along each other in `time` (s).
  double way_in(double time) const;
  // Rate (m/s) of the gap of a contact.
  double gap_rate(const ContactInput& contact) const;
  // Apparent inverse mass (1/kg) along the normal of a contact; of links MuJoCo's estimate.
  double inverse_mass(const ContactInput& contact, const Trees& trees) const;
  // Whether a joint that a link hangs on turns by more than `angle` (rad, or m) in the step.
  bool joints_move(int side, double angle) const;

  // Finds what point_rate() needs of bodies that are not free; `time` (s) leads to When::kThen.
  void find_twists(double time);
  // Velocity (m/s) of the point on the second geom to that on the first, in the contact's frame, at
  // the start of the step, or then.
  enum class When { kStart, kThen };
  std::array<double, 3> point_rate(const ContactInput& contact, When when) const;

 private:
  struct Side {
    int geom = -1, body = -1;
    bool is_free = false;
    const mjtNum* centre = nullptr;  // see centre_of_motion
    mjtNum angular[3]{}, linear[3]{};
    // Of all but free bodies, about the centre of mass of the tree: at the start, and then.
    mjtNum twist[2][6]{};
  };

  void find_velocity(int tree, const TurningStep& step, Side& side) const;
  // Of a point that moves with the body of a side.
  void velocity_of(const Side& side, const mjtNum* point, mjtNum* velocity) const;

  const mjModel* model_;
  const mjData* data_;
  double length_;
  std::array<Side, 2> side_;
  mjtNum relative_[3]{};
};

}  // namespace dashpot::host
