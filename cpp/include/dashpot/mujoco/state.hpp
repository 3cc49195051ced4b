// The state in mjData: positions and velocities of trees, contact memory.

#pragma once

#include <vector>

#include "dashpot/mujoco/welded_parts.hpp"
#include "dashpot/rows/free_body.hpp"
#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

const double* position(const mjData_* d);
const double* velocity(const mjData_* d);

// `acceleration` is the smooth generalized acceleration of the tree; `parts` are those of a body
// that has_welded_parts, null of all others.
FreeBody read_free_body(const mjModel_* m, const mjData_* d, int tree, const WeldedParts* parts,
                        const double* acceleration);
Eigen::Quaterniond orientation(const mjModel_* m, const mjData_* d, int tree);
void write_free_body(const mjModel_* m, mjData_* d, int tree, const FreeBody& body);

void set_velocity(mjData_* d, const std::vector<double>& velocity);  // (nv)
// Adds `change` to the velocity of one tree; one entry per degree of freedom of it.
void add_velocity(mjData_* d, const Tree& tree, const double* change);
// Replaces the state of one tree by `velocity`, and by positions moved from `start_position` (nq)
// by `displacement`; both are generalized, one entry per degree of freedom of the tree.
void write_tree(const mjModel_* m, mjData_* d, const Tree& tree, const double* start_position,
                const double* displacement, const double* velocity);

// Copies everything that steps go on from.
void copy_state(const mjModel_* m, const mjData_* d, mjData_* to);

// Contact memory lives behind the model's own user data: `size` doubles.
void reserve_memory(mjModel_* m, int size);
double* memory(const mjModel_* m, mjData_* d, int size);

}  // namespace dashpot::host
