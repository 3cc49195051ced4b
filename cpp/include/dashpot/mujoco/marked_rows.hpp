// Which rows what sleeps, or what was moved by hand, may have.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// The rows of marked degrees of freedom, of some bodies, and of all that hangs on them.
void mark_rows(const mjModel_* m, const std::vector<char>& dof, const std::vector<int>& bodies,
               MarkedRows& rows);

// Marks the degrees of freedom of bodies whose positions differ by more than 2 um or urad from
// those remembered (nq); returns whether there are any.
bool find_moved_by_hand(const mjModel_* m, const mjData_* d, const double* remembered,
                        std::vector<char>& dof);

}  // namespace dashpot::host
