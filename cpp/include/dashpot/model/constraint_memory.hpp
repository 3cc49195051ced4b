// Where scalar constraints have their memory (rows/memory.hpp): ConstraintInput::memory of the
// first row of each; its others follow. And which rows are of what sleeps, or was moved by hand.

#pragma once

#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot::host {

inline constexpr int kLimitSides = 2;

int memory_of_equality(const mjModel_* m, int equality);
int equality_rows(const mjModel_* m, int equality);  // at most
int memory_of_friction(const mjModel_* m, int dof);
int memory_of_tendon_friction(const mjModel_* m, int tendon);
int memory_of_joint_limit(const mjModel_* m, int joint);  // the lower side, the upper one follows
int memory_of_tendon_limit(const mjModel_* m, int tendon);
int constraint_memory_count(const mjModel_* m);  // of the model

// The rows of marked degrees of freedom, of some bodies, and of all that hangs on them.
void mark_rows(const mjModel_* m, const std::vector<char>& dof, const std::vector<int>& bodies,
               MarkedRows& rows);

// Marks the degrees of freedom of bodies whose positions differ by more than 2 um or urad from
// those remembered (nq); returns whether there are any.
bool find_moved_by_hand(const mjModel_* m, const mjData_* d, const double* remembered,
                        std::vector<char>& dof);

}  // namespace dashpot::host
