// What `discrete` integrates implicitly: springs, dampers, servos, drag and elasticity of flexes.
//
// It steps in the metric
//
//     H = M + h D + h^2 K,    H (v' - v) / h = f - h K v + J'F,
//
// K and D being the derivatives of these forces with respect to position and velocity, of either
// only what resists. So f is that of where v alone would take the bodies. MuJoCo finds K and D;
// here they are entries of trees (Trees::implicit). Trees that no row holds go as in MuJoCo.
//
// Held over the step, the shift -h K v would drive what a row stops back from it, step after step.
// So in the micro-steps of a tree that rows may hold (microstep.hpp) springs act along, and K's
// part of the metric is a damper h K beside them: with e = h / 4 and x how far the tree has gone,
//
//     (M + e (D + h K)) v' = f - (D + h K) (v - v0) - h K v0 - K x + J'F.
//
// Modes that steps do not resolve relax within e; statics are f - K x + J'F = 0. f: of the start.

#pragma once

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

bool is_discrete(const mjModel_* m);

// Of smooth_stage(): builds K and D at its positions, before velocities are known.
void build_metric(const mjModel_* m, mjData_* d);
// Of smooth_stage(): actuation and smooth acceleration in that metric. Asks the control callback.
void accelerate_in_metric(const mjModel_* m, mjData_* d);
// Takes K and D over from MuJoCo, where a smooth stage has left any. Throws std::invalid_argument
// where they couple what the trees do not, since the integrator was another when these were made.
void take_metric(const mjModel_* m, mjData_* d, Trees& trees);

// Factors M + h (D + T K) of a sparse tree whose springs couple its bodies, T the time step; false
// where it is not positive definite.
bool factor_coupled(const mjModel_* m, const mjData_* d, Trees& trees, int tree, double h);

// Adds -h K v (nv) to a force, over one tree.
void add_stiffness_shift(const mjModel_* m, const Trees& trees, int tree, const double* v,
                         double* force);

}  // namespace dashpot::host
