// Jacobian rows of contacts and constraints.

#pragma once

#include <array>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

class RowTurns;

// The trees that a row of MuJoCo's constraint Jacobian reaches, -1 where fewer than two. Throws
// std::invalid_argument if there are more.
std::array<int, 2> trees_of_row(const mjModel_* m, const mjData_* d, int source);
// Appends sparse rows for the group that was appended last, from `source` on in MuJoCo's.
void append_rows(const mjModel_* m, const mjData_* d, int source, const Trees& trees, Rows& rows);
// Whether the rows of a contact are those of a PairGeometry, and what it is.
bool has_pair_geometry(const mjModel_* m, const mjData_* d, const ContactInput& input,
                       const Trees& trees);
PairGeometry pair_geometry(const mjModel_* m, const mjData_* d, const ContactInput& input,
                           const Trees& trees);
// Appends the sparse rows of a scalar constraint for the group that was appended last.
void append_jacobian(const mjModel_* m, const mjData_* d, const ConstraintInput& input,
                     const Trees& trees, const RowTurns& turns, Rows& rows);
// The same of a contact without a pair geometry, in two steps: the columns and room for the rows,
// then what is in them, which several threads may fill in at once.
void append_columns(const mjModel_* m, const mjData_* d, const ContactInput& input,
                    const Trees& trees, Rows& rows);
void fill_jacobian(const mjModel_* m, const mjData_* d, const ContactInput& input,
                   const Trees& trees, const RowGroup& group, Rows& rows);

// MuJoCo's estimates of the inverse masses of a constraint's row, of a contact's normal, and of the
// `dim` rows of a contact that has these coefficients of friction. Of rigid joint and tendon
// equalities with the slope of their polynomial, which MuJoCo leaves out.
double typical_inverse_mass(const mjModel_* m, const mjData_* d, const ConstraintInput& input);
double typical_inverse_mass(const mjModel_* m, const mjData_* d, const ContactInput& input);
void typical_inverse_masses(const mjModel_* m, const mjData_* d, const ContactInput& input,
                            const std::array<double, 5>& friction, double* typical);

}  // namespace dashpot::host
