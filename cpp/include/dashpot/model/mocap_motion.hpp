// Motion of the bodies that users alone move (mocap_bodies.hpp): mocap bodies, and static ones that
// are fixed to the world, by edits of the model.
//
// Users set their poses in jumps: every step, or now and then. MuJoCo gives these bodies no
// velocity; its soft rows turn the violation that a jump leaves into motion within their time
// constant. Here rows are rigid, so the body itself moves: during a step it goes, with a velocity
// that its contacts, welds and tendons see, to where it is told to be or, until the time that
// mocap_bodies.hpp gives it is over, a part of the way. A mocap body that holds something goes to
// where a critically damped follower of the commanded pose will be,
//
//     x'' = -2 x' / T - x / T^2 ,    c = x' + x / T ,
//     x(h) = (x + c h) exp(-h/T) ,   x'(h) = (x' - c h / T) exp(-h/T) ,
//
// with x the offset from the commanded pose: three numbers of translation, three
// of rotation. T is 20 ms by default, MuJoCo's time constant, so that a weld that nothing loads
// moves as MuJoCo's does. T = 0 has every body arrive at the end of the step.
//
// In a step its velocity is linear about the mean v_n, with the a_n of mocap_bodies.hpp.
//
// Contacts see a_n along the gap and of sliding, as an acceleration of their surfaces
// (ContactInput::surface_acceleration) about v_n. Spin and rolling of contacts, equalities and
// tendons see v_n alone: springs of either sign take up what it jumps by. In steps that are taken
// in substeps a_n is that of the whole step, and v of each substep, in cvel too, the mean of v(t)
// over it. A body that equalities hold to has a_n = 0: it is where they see it at ends of substeps.

#pragma once

#include <cstddef>
#include <vector>

#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot::host {

struct MocapBody {
  RememberedMocap now{};
  bool rests = false;    // is where it is told to be, and was before
  bool settles = false;  // jumped or begins, and nobody has looked yet where what it holds is
  // Mean velocity during the substep, and the acceleration within it; world.
  MocapVector velocity{}, angular{};
  MocapVector acceleration{}, angular_acceleration{};
};
// Kept from step to step: a step allocates nothing.
struct MocapBuffers {
  const std::vector<int>& find_bodies(const mjModel_* m);

  std::vector<int> id, of_body;  // driven_bodies(), and which of them carries a body, -1 for none
  std::vector<size_t> active;    // those that do not rest
  std::vector<int> jumped;       // bodies that are elsewhere, without motion
  std::vector<MocapBody> body;
  std::vector<MocapPlace> place;
  std::vector<double> end_position;  // of constraints, by memory; NaN for none
  std::vector<double> drive;         // of constraints, by memory; empty until drive()
  std::vector<ConstraintInput> constraints;
};

// These bodies during a step, at whose end they are where they were told to be (mocap_bodies.hpp).
class MocapMotion {
 public:
  // `moves` false: bodies are at once where they are told to be, without motion, as in MuJoCo.
  MocapMotion(const mjModel_* m, mjData_* d, bool moves, double time_constant, const Memory& memory,
              MocapBuffers& buffers);

  // Begins a substep of at most `length` (s): finds how the bodies move in it, and what of
  // it scalar constraints see, and puts the bodies where they are at its start.
  void begin(double length);
  // Ends the substep earlier, after `length` (s): velocities become the means up to there.
  void shorten(double length);
  // Writes the mean velocities over the part of bodies without joints to d->cvel, which mj_comVel
  // has left at zero. What hangs on them by joints keeps MuJoCo's, relative to them.
  void write_velocities() const;
  // Sets the rates at which the motion drives constraints: from their positions at the first call
  // of a substep, where they are at its start, and the same at others.
  void drive(std::vector<ConstraintInput>& constraints);
  // Sets the accelerations at which it drives contacts.
  void drive(std::vector<ContactInput>& contacts) const;
  // Whether a geom is of a mocap body that moves in this substep, or hangs on one.
  bool moves(int geom) const;
  // Puts the bodies where they are a time (s) after the start of the substep.
  void show(double time);
  // Work (J) against gravity of taking the bodies, and what hangs on them, through `length`.
  double work_against_gravity(double length) const;
  // Ends the substep, of `length`.
  void advance(double length);
  void remember(Memory& memory) const;

 private:
  bool anything_moves() const;
  const MocapBody* carrier_of(int id) const;
  void find_mean_velocity(double length, MocapBody& body) const;
  void find_acceleration(double length, size_t index);
  void add_acceleration(int geom, const MocapVector& position, double sign,
                        MocapVector& acceleration) const;
  void find_constraints(double length);

  const mjModel_* model_;
  mjData_* data_;
  bool moves_;
  double time_constant_;       // s
  double searched_ = 0.0;      // s: of the substep, as begin() was given it
  double length_ = 0.0;        // s: the same, shortened
  bool first_substep_ = true;  // of the step
  MocapBuffers& buffers_;
  MocapPlaces places_;
};

}  // namespace dashpot::host
