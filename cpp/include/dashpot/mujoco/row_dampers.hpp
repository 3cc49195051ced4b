// Dampers that act as rows in the micro-steps.
//
// The force of a damper that H does not have is held over the step: that of tendons and edges of
// flexes with Euler and RK4, and between branches with all integrators. What it overshoots MuJoCo's
// constraint solver takes back. Springs do not, and rows beside it gained energy in every step. So
// while anything is in touch a damper that takes some of its velocity in a step is a row: a slider
// without stiffness or limit, whose flow is closed form. MuJoCo sees the model without it.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct RowDamper {
  int source;                         // as ConstraintInput::source, below zero
  std::array<double, 3> coefficient;  // of (c + c_1 |v| + c_2 v^2) v
};

// While it lives, the model is without the dampers that act as rows, which are kept in `dampers`:
// none where `any` is false.
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

}  // namespace dashpot::host
