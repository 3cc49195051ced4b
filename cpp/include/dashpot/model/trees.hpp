// Kinematic trees, and those that single constraint rows couple.

#pragma once

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

int tree_count(const mjModel_* m);  // without those joined to others
// Trees that are one free body: no other joint is in it, whatever is welded to it.
bool is_free_body(const mjModel_* m, int tree);
// Directions of the world at right angles to each other (at most three unit vectors) along which
// the first joints of a tree let it go as a whole; returns how many.
int translations(const mjModel_* m, const mjData_* d, int tree, double* direction);
// Adds the motion of a tree (coordinates of all trees) that goes at 1 m/s along a direction as a
// whole; false where its joints let it not.
bool add_translation(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                     const double* direction, double* motion);
// The layout of trees in motion coordinates.
Trees make_trees(const mjModel_* m);

// Trees that a single row may couple by more than two (a tendon over three bodies, a flex) are
// joined to one in the model, so that a row has at most two. Their number stays; the surplus ones
// are empty and last. They never sleep. Changes nothing else that MuJoCo computes.
void join_coupled_trees(mjModel_* m);

}  // namespace dashpot::host
