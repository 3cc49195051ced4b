#include "dashpot/mujoco/mocap_places.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

namespace dashpot::host {

namespace {

MocapPose pose_in(const mjData* d, size_t index) {
  MocapPose pose;
  std::copy_n(d->mocap_pos + 3 * index, 3, pose.begin());
  std::copy_n(d->mocap_quat + 4 * index, 4, pose.begin() + 3);
  return pose;
}

}  // namespace

MocapPlaces::MocapPlaces(const mjModel* m, mjData* d, std::vector<MocapPlace>& place)
    : data_(d), place_(place) {
  place.resize(m->nmocap);
  for (size_t i = 0; i < place.size(); ++i) {
    place[i].given = pose_in(d, i);
    place[i].placed = place[i].left = place[i].given;
  }
}

MocapPlaces::~MocapPlaces() {
  for (size_t i = 0; i < place_.size(); ++i) {
    keep_what_was_set(i);
    put(i, place_[i].left);
  }
}

// Keeps the pose that a callback has set since the body was placed.
void MocapPlaces::keep_what_was_set(size_t index) {
  MocapPlace& place = place_[index];
  if (const MocapPose now = pose_in(data_, index); now != place.placed) place.left = now;
}

void MocapPlaces::put(size_t index, const MocapPose& pose) {
  keep_what_was_set(index);
  place_[index].placed = pose;
  std::copy_n(pose.begin(), 3, data_->mocap_pos + 3 * index);
  std::copy_n(pose.begin() + 3, 4, data_->mocap_quat + 4 * index);
}

}  // namespace dashpot::host
