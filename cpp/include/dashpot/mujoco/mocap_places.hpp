// Where driven bodies (mocap_bodies.hpp) are put during a step, whose end leaves them where users
// told them to be: mocap bodies in mjData, those that edits of the model move in the model.

#pragma once

#include <array>
#include <cstddef>
#include <vector>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

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
  // Takes fixed bodies to where they are put, which MuJoCo's kinematics leave where they were if
  // trees may sleep.
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

}  // namespace dashpot::host
