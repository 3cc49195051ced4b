// Contacts that MuJoCo has no room for.
//
// It keeps room for a pair's contacts by the types of its geoms: eight of two boxes, four of a
// mesh. What faces share beyond that waits until collision is done, and then goes in beside the
// pair's other contacts.

#pragma once

#include <array>
#include <vector>

struct mjData_;

namespace dashpot::host {

struct SurplusContact {
  std::array<int, 2> geom;
  double distance;
  std::array<double, 3> position, normal;
};

// After MuJoCo's collision, before its rows: adds contacts to those of their pairs, in the order in
// which it asked for them. Whether they fit into the memory of the model; if not, none are added.
bool add_surplus(mjData_* d, const std::vector<SurplusContact>& surplus);

}  // namespace dashpot::host
