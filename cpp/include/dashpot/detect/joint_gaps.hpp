// What a single joint between two geoms keeps apart.
//
// Links that face each other along the axis of a hinge, or across that of a slide, stay as far
// apart as they are wherever the joint goes. Contact between them cannot be loaded.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

// Whether the one joint that moves two geoms against each other keeps a contact, which is apart, as
// it is: along a line across its normal or about it.
bool keeps_its_gap(const mjModel_* m, const mjData_* d, const mjContact_& contact);

// Gaps that joints keep between whole geoms, each found when it is first asked for.
class JointGaps {
 public:
  // For the model was edited.
  void forget() { known_.clear(); }
  // Whether geoms of types with a core stay `distance` (m) apart, up to rounding, wherever the one
  // joint between them goes. False where there is none, or more than one.
  bool keep_apart(const mjModel_* m, const mjData_* d, int geom1, int geom2, double distance);

 private:
  struct Known {
    std::array<int, 2> geom;
    double gap;  // m
  };
  std::vector<Known> known_;
};

}  // namespace dashpot::host
