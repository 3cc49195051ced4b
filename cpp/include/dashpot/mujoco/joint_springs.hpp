// Springs of single joints, slides and hinges: their force changes linearly with the way of that
// joint alone, so that micro-steps can follow it (microstep.hpp).

#pragma once

#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Fills in Trees::stiffness. No tree is sprung then.
void find_joint_springs(const mjModel_* m, Trees& trees);
// Force of such a spring on a degree of freedom at the start of the step, N or N m; 0 of others.
double joint_spring_force(const mjModel_* m, const mjData_* d, int dof);

}  // namespace dashpot::host
