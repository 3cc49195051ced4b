// Where mocap bodies are put in mjData during a step, whose end leaves them where users told them
// to be.

#pragma once

#include <cstddef>
#include <vector>

#include "dashpot/mujoco/mocap_pose.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Poses that mjData had, has meanwhile, and gets in the end.
struct MocapPlace {
  MocapPose given{}, placed{}, left{};
};

// At its end, also where the step throws, `d` has the poses that it began with again, or what a
// callback has set since a body was last placed.
class MocapPlaces {
 public:
  // `place`: kept from step to step, as a step allocates nothing.
  MocapPlaces(const mjModel_* m, mjData_* d, std::vector<MocapPlace>& place);
  ~MocapPlaces();
  MocapPlaces(const MocapPlaces&) = delete;
  MocapPlaces& operator=(const MocapPlaces&) = delete;

  // The pose that mjData had at the start of the step, its quaternion as it was given.
  const MocapPose& given(size_t index) const { return place_[index].given; }
  void put(size_t index, const MocapPose& pose);

 private:
  void keep_what_was_set(size_t index);

  mjData_* data_;
  std::vector<MocapPlace>& place_;
};

}  // namespace dashpot::host
