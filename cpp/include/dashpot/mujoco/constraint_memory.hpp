// Where scalar constraints have their memory (rows/memory.hpp): ConstraintInput::memory of the
// first row that each of them may have. Its others follow.

#pragma once

struct mjModel_;

namespace dashpot::host {

inline constexpr int kLimitSides = 2;

int memory_of_equality(const mjModel_* m, int equality);
int equality_rows(const mjModel_* m, int equality);  // at most
int memory_of_friction(const mjModel_* m, int dof);
int memory_of_tendon_friction(const mjModel_* m, int tendon);
int memory_of_joint_limit(const mjModel_* m, int joint);  // the lower side, the upper one follows
int memory_of_tendon_limit(const mjModel_* m, int tendon);
int constraint_memory_count(const mjModel_* m);  // of the model

}  // namespace dashpot::host
