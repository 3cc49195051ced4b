// Velocity derivatives with which no inertia is left.
//
// Implicit integrators step with M + h D, D = -dF/dv. Forces that grow with velocity, as those of
// fluids on plates or of drives with the wrong sign, make it indefinite where h is long: it would
// turn their push round. Then D keeps what damps, and what drives acts as it is at the start:
//
//     M + h D = sum_i (1 + h l_i) (M x_i) (M x_i)',   D x_i = l_i M x_i,   x_i' M x_i = 1,
//
// with 0 for those l_i with 1 + h l_i < 1/2. In trees with branches, whose M has zeros, D becomes
// diagonal instead: of each row the sum of the sizes of its entries, no less than D.

#pragma once

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Changes the derivatives of a tree so that M + h D, h the time step, is positive definite if M is.
void keep_what_damps(const mjModel_* m, mjData_* d, int tree);

}  // namespace dashpot::host
