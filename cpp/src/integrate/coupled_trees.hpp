// Which trees share the scale of the Verlet corrector of a step (trapezoid.hpp).
//
// What equalities couple exchanges energy through them, and is conserved only of all together:
// such trees go by the first of them.

#pragma once

#include <vector>

#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// Finds for every tree the first one that equalities couple it to, -1 if none do.
void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree);

}  // namespace dashpot
