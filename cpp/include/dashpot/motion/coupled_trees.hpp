// Which trees have a second half of a step (trapezoid.hpp), and which of them share its scale.
//
// Those that rows hold, or have held in the last step, where their motion does not know of it yet.
// What equalities couple exchanges energy through them, and is conserved only of all together:
// such trees go by the first of them.

#pragma once

#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

struct mjModel_;

namespace dashpot {

// Finds for every tree the first one that equalities couple it to, -1 if none do.
void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree);
// Then lets each of the others that contacts or limits may hold be its own first one, but for free
// bodies.
void add_held_trees(const mjModel_* model, const Rows& rows, std::vector<int>& first_tree);
// Then does the same for those that rows held in the last step and hold no more.
void add_freed_trees(const mjModel_* model, const HeldMotion& before, std::vector<int>& first_tree);

}  // namespace dashpot
