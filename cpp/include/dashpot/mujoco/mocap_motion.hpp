// Motion of mocap bodies.
//
// Users set the poses of mocap bodies, in jumps: every step, or now and then. MuJoCo gives these
// bodies no velocity; its soft rows turn the violation that a jump leaves into motion within their
// time constant. Here rows are rigid, so the body itself moves: during a step it goes, with a
// velocity that its contacts, welds and tendons see, from where it is to where a critically damped
// follower of the commanded pose will be,
//
//     x'' = -2 x' / T - x / T^2 ,    c = x' + x / T ,
//     x(h) = (x + c h) exp(-h/T) ,   x'(h) = (x' - c h / T) exp(-h/T) ,
//
// with x the offset from the commanded pose: three numbers of translation, three
// of rotation. T is 20 ms by default, MuJoCo's time constant, so that a weld that nothing loads
// moves as MuJoCo's does. T = 0 has the body arrive at the end of the step. A jump that no motion
// is meant by takes the body there without any: a far one (kJump, kJumpTurn), unless T > 0
// and it leaves behind what a connect or weld holds to the body. A body that nothing is remembered
// of, and that is farther from what it holds than springs bear (kApart, kApartTurn), has jumped
// there from it.
//
// Within a step its velocity is linear about the mean v_n, with the acceleration a_n of
// mocap_acceleration.hpp.
//
// Contacts see a_n along the gap and of sliding, as an acceleration of their surfaces
// (ContactInput::surface_acceleration) about v_n. Spin and rolling of contacts, equalities and
// tendons see v_n alone: springs of either sign take up what it jumps by. In steps that are taken
// in parts a_n is that of the whole step, and v of each part, in cvel too, the mean of v(t) over
// it. A body that equalities hold to has a_n = 0, so that it is where they see it wherever a part
// ends.

#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "dashpot/mujoco/mocap_bodies.hpp"
#include "dashpot/rows/memory.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct MocapBody {
  // Poses that mjData had, has meanwhile, and gets in the end.
  std::array<double, 7> given{}, placed{}, left{};
  RememberedMocap now{};
  bool jumps = false;   // far, and nobody has looked yet whether that is a motion
  bool starts = false;  // nothing is remembered, and nobody has looked yet where what it holds is
  // Mean velocity during the part, and the acceleration within it; world.
  std::array<double, 3> velocity{}, angular{};
  std::array<double, 3> acceleration{}, angular_acceleration{};
};
// Kept from step to step: a step allocates nothing.
struct MocapBuffers {
  std::vector<MocapBody> body;
  std::vector<double> end_position;  // of constraints, by memory; NaN for none
  std::vector<double> drive;         // of constraints, by memory; empty until drive()
  std::vector<ConstraintInput> constraints;
};

// The mocap bodies of `d` during a step. At its end, also where it throws, `d` has the commanded
// poses again, or what a callback has set in any part of the step.
class MocapMotion {
 public:
  // `moves` false: bodies are at once where they are told to be, without motion, as in MuJoCo.
  MocapMotion(const mjModel_* m, mjData_* d, bool moves, double time_constant, const Memory& memory,
              MocapBuffers& buffers);
  ~MocapMotion();
  MocapMotion(const MocapMotion&) = delete;
  MocapMotion& operator=(const MocapMotion&) = delete;

  // Begins a part of the step of at most `length` (s): finds how the bodies move in it, and what of
  // it scalar constraints see, and puts the bodies where they are at its start.
  void begin(double length);
  // Ends the part earlier, after `length` (s): velocities become the means up to there.
  void shorten(double length);
  // Writes the mean velocities over the part of bodies without joints to d->cvel, which mj_comVel
  // has left at zero. What hangs on them by joints keeps MuJoCo's, relative to them.
  void write_velocities() const;
  // Sets the rates at which the motion drives constraints: from their positions at the first call
  // of a part, where they are at its start, and the same at others.
  void drive(std::vector<ConstraintInput>& constraints);
  // Sets the accelerations at which it drives contacts.
  void drive(std::vector<ContactInput>& contacts) const;
  // Whether a geom is of a mocap body that moves in this part, or hangs on one.
  bool moves(int geom) const;
  // Puts the bodies where they are a time (s) after the start of the part.
  void show(double time);
  // Work (J) that taking the bodies, and what hangs on them, through the part of `length` does
  // against gravity.
  double work_against_gravity(double length) const;
  // Ends the part, of `length`.
  void advance(double length);
  void remember(Memory& memory) const;

 private:
  bool anything_moves() const;
  void find_mean_velocity(double length, MocapBody& body) const;
  void find_acceleration(double length, size_t index);
  void add_acceleration(int geom, const std::array<double, 3>& position, double sign,
                        std::array<double, 3>& acceleration) const;
  void keep_what_was_set(size_t index);
  void place(size_t index, const std::array<double, 7>& pose);
  void settle_jump(size_t index);
  void settle_start(size_t index);
  double violation(size_t index, const std::array<double, 7>& pose);
  void find_constraints(double length);

  const mjModel_* model_;
  mjData_* data_;
  bool moves_;
  double time_constant_;                  // s
  double searched_ = 0.0, length_ = 0.0;  // s: of the part, as begin() was given it, and shortened
  bool first_part_ = true;                // of the step
  MocapBuffers& buffers_;
};

}  // namespace dashpot::host
