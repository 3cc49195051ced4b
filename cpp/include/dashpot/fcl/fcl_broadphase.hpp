// Pairs of overlapping boxes by FCL's dynamic AABB tree. The only room that includes FCL.
//
// FCL's narrow phase is not used: the libfcl that Debian ships is built with assertions that abort
// the process on nearly degenerate simplices.

#pragma once

#include <Eigen/Geometry>
#include <utility>
#include <vector>

namespace dashpot {

// Index pairs (smaller first, in ascending order) of axis-aligned boxes that overlap or touch.
std::vector<std::pair<int, int>> overlapping_pairs(const std::vector<Eigen::AlignedBox3d>& boxes);

}  // namespace dashpot
