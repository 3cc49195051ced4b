// Which bodies users alone move, and what they hold: mocap bodies, and bodies that are fixed to the
// world, which edits of the model move.

#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot::host {

// Their numbers: mocap bodies in their order, then children of the world without a joint.
std::vector<int> driven_bodies(const mjModel_* m);
// Whether a body is fixed to the world, or to one of these.
bool is_fixed(const mjModel_* m, int body);
// Rotation and translation (6, as in cvel and about the same point) by which one of these takes a
// body along that is fixed to it or hangs on it by joints; null for all others.
const double* mocap_twist(const mjModel_* m, const mjData_* d, int body);
// Whether a connect or weld holds something to a mocap body. What it pulls at may be unable to
// follow, and a rigid row would tear at it: such rows are as soft as their solref, set or default.
bool is_held_by_mocap(const mjModel_* m, int equality);
// Whether an equality is a connect or weld of a mocap body, by its index among them, or of what is
// fixed to it; and whether any active one is.
bool holds(const mjModel_* m, int equality, int mocap);
bool holds_anything(const mjModel_* m, const mjData_* d, int mocap);

// Where driven bodies (driven_bodies) are put during a step, whose end leaves them where users
// told them to be: mocap bodies in mjData, those that edits of the model move in the model.

using MocapVector = std::array<double, 3>;  // world
using MocapPose = std::array<double, 7>;    // position (m) and unit quaternion

// From one pose to another: translation (m), and rotation vector (rad, world).
MocapVector offset(const MocapPose& from, const MocapPose& to);
MocapVector turn(const MocapPose& from, const MocapPose& to);
// Moves a pose by both.
void move(MocapPose& pose, const MocapVector& way, const MocapVector& angle);
// Turns a quaternion by a rotation vector (rad, world).
void rotate(double* quaternion, const MocapVector& angle);
// Whether all of a pose is finite, and its quaternion about as long as 1.
bool is_pose(const MocapPose& pose);

// The critically damped follower (mocap_motion.hpp) of one of the two after a time (s): its offset
// from the commanded pose, and the rate of that.
void follow(double time_constant, double time, MocapVector& x, MocapVector& rate);

// Poses that a body had, has meanwhile, and gets in the end.
struct MocapPlace {
  MocapPose given{}, placed{}, left{};
};

// At its end, also where the step throws, bodies have the poses that it began with again, or what a
// callback has set since a body was last placed.
class MocapPlaces {
 public:
  // `body`: driven_bodies(); `started`: the indices of those for which start() is called; `place`:
  // kept from step to step, as a step allocates nothing. Changes poses in `m` meanwhile.
  MocapPlaces(const mjModel_* m, mjData_* d, const std::vector<int>& body,
              const std::vector<size_t>& started, std::vector<MocapPlace>& place);
  ~MocapPlaces();
  MocapPlaces(const MocapPlaces&) = delete;
  MocapPlaces& operator=(const MocapPlaces&) = delete;

  // The pose of a body, of any; the others are for those that are started.
  MocapPose pose(size_t index) const;
  void start(size_t index);
  // The pose that it had at the start of the step, its quaternion as it was given.
  const MocapPose& given(size_t index) const { return place_[index].given; }
  void put(size_t index, const MocapPose& pose);
  // Takes fixed bodies to where they are put; MuJoCo's kinematics do not if trees may sleep.
  void update_fixed_bodies();

 private:
  struct Numbers {
    double *position, *quaternion;
  };
  Numbers numbers(size_t index) const;
  void keep_what_was_set(size_t index);

  mjModel_* model_;
  mjData_* data_;
  const std::vector<int>& body_;
  const std::vector<size_t>& started_;
  std::vector<MocapPlace>& place_;
};

// Poses set in jumps: when a body is to be there, which jumps are motions, their acceleration.
//
// Poses that follow on one another within 0.1 s (five time constants) have a rhythm: a body goes at
// a constant velocity to be where it is told when the next pose comes. Told in every step it is
// there at the end of the step, and what is seen then is what contacts saw. A single pose, as the
// first of many, is reached at 0.25 m/s, or within a time constant where that is shorter. So no
// jump is a blow: a body that is behind goes at most 1.25 times as fast as it is told to, beyond
// 1 m/s as it was told before too. What a body turns counts as the way of a point 0.1 m away.
//
// A jump of more than 0.1 m or 0.5 rad is no motion: the body is there at once (at_rest). But one
// that follows slowly (mocap_motion.hpp) begins where what a connect or weld holds to it is, if
// that is farther than springs bear (2 cm, 0.1 rad); so does one that nothing is remembered of, as
// after resets that have a hand fetched.
//
// Acceleration of mocap bodies within a step.
//
// At a constant velocity in each step, that of a body with the acceleration a would jump by a H
// from one step of length H to the next, and what it carries would slip. So within step n it is
// linear about its mean v_n,
//
//     v(t) = v_n + a_n (t - H_n / 2) ,   a_n = c_n + (c_n - c_n-1) / 2 ,
//     c_n = 2 (v_n - v_n-1) / (H_n + H_n-1) ,
//
// c_n being the acceleration at its start, a_n that in its middle. Of a motion x(t) that goes on
// from step to step jumps of H^3 / 4 x'''' are left. Where one starts, stops or turns back at once,
// a_n would lead on beyond what is asked for, and throw what is carried. There c does not grow as
// in the step before (kSteadyGrowth), and a_n is at most twice c_n-1 (kMostGrowth), and 0 where it
// is against it: a jump of velocity stays one, and what sets out from rest, c_1 = a / 2, has its
// acceleration from the second step on.

// Tells a body where to be, at a time (s). One that `follows` has none to be there.
void tell(const mjModel_* m, double time, const MocapPose& command, bool follows,
          double time_constant, RememberedMocap& now);
// Whether what memory has of a body is a motion: not before the first step, nor of other storage.
bool is_known(const RememberedMocap& mocap);
// Whether a body goes farther in one step than motions do.
bool is_far(const mjModel_* m, const MocapPose& from, const MocapPose& to);
// Of a body at rest where it is told to be.
RememberedMocap at_rest(const MocapPose& command);

// Where a body that holds something, and jumped to now.command or has nothing to go on from,
// begins. Leaves the kinematics of `d` at that command.
void settle(const mjModel_* m, mjData_* d, size_t index, MocapPlaces& places, RememberedMocap& now);

// Returns a_n (m/s^2 or rad/s^2) of the mean velocity v_n, whose step has its middle `between` (s)
// after that of the step before, of which `mean` is; that becomes this step's.
std::array<double, 3> accelerate(const std::array<double, 3>& velocity, double between,
                                 MeanRate& mean);

}  // namespace dashpot::host
