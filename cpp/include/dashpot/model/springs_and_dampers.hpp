// Springs and dampers that act in the micro-steps. Springs of slides and hinges change their force
// linearly with the way of that joint alone, so that micro-steps can follow it (microstep.hpp).

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot::host {

// Fills in Trees::stiffness. No tree is sprung then.
void find_joint_springs(const mjModel_* m, Trees& trees);
// Force of such a spring on a degree of freedom at the start of the step, N or N m; 0 of others.
double joint_spring_force(const mjModel_* m, const mjData_* d, int dof);

// Dampers that act as rows in the micro-steps.
//
// The force of a damper that H does not have is held over the step: that of tendons and edges of
// flexes with Euler and RK4, and between branches with all integrators. What it overshoots MuJoCo's
// constraint solver takes back. Springs do not, and rows beside it would gain energy. So
// while anything is in touch a damper that takes some of its velocity in a step is a row: a slider
// without stiffness or limit, whose flow is closed form. MuJoCo sees the model without it.

struct RowDamper {
  int source;                         // as ConstraintInput::source, below zero
  std::array<double, 3> coefficient;  // of (c + c_1 |v| + c_2 v^2) v
};

// While it lives, the model is without the dampers that act as rows, kept in `dampers`, if `any`.
class DampersInRows {
 public:
  DampersInRows(mjModel_* m, bool any, std::vector<RowDamper>& dampers);
  ~DampersInRows();
  DampersInRows(const DampersInRows&) = delete;
  DampersInRows& operator=(const DampersInRows&) = delete;

 private:
  mjModel_* model_;
  std::vector<RowDamper>& dampers_;
};

// Appends the rows of those that are awake, as they damp at the velocity of the data.
void append_dampers(const mjModel_* m, const mjData_* d, const std::vector<RowDamper>& dampers,
                    std::vector<ConstraintInput>& constraints);

// A row over degrees of freedom.
struct SparseRow {
  const int* dof;
  const double* value;
  int count;
};
// J of a damper by its source.
SparseRow damper_row(const mjModel_* m, const mjData_* d, int source);
// MuJoCo's estimate of its inverse mass, from the reference configuration.
double damper_inverse_mass(const mjModel_* m, int source);

// Velocity derivatives with which no inertia is left.
//
// Implicit integrators step with M + h D, D = -dF/dv. Forces that grow with velocity, as those of
// fluids on plates or of drives with the wrong sign, make it indefinite where h is long. The smooth
// motion goes through it all the same, as in MuJoCo (effective_inertia.hpp). Rows need what is
// positive definite: for them D becomes diagonal, of each row the sum of the sizes of its entries,
// which is no less than D.

// Changes the derivatives of a tree so that M + h D, h the time step, is positive definite if M is.
void keep_what_damps(const mjModel_* m, mjData_* d, int tree);

// The smooth acceleration of a tree by all its derivatives, as MuJoCo's. False where near singular.
bool solve_whole(const mjModel_* m, const mjData_* d, const Tree& t, double* acceleration);

}  // namespace dashpot::host
