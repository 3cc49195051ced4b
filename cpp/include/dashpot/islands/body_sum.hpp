// The sum S_T of coupled_sum.hpp for a free body, and its bound.
//
// A row of a contact is (n, a x n) for the body, linear and angular, with the arm a from its centre
// of mass; the angular rows of a contact are (0, n). Of the two mixed blocks of S, each the other's
// transpose, the one of linear columns and angular rows is kept.

#pragma once

#include "dashpot/lanes/lanes.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// Columns of three numbers and a zero.
struct BodySum {
  Lanes linear[3] = {}, mixed[3] = {}, angular[3] = {};
};

// sum += sum_i weight_i row_i' row_i over `dim` rows of a contact from the row `first` on.
void add_rows(const PairGeometry& pair, int side, int first, int dim, const double* weight,
              BodySum& sum);

// The same over all `dim` rows, of which the first goes to `normal` and the others to `friction`.
void add_contact(const PairGeometry& pair, int side, int dim, const double* weight, BodySum& normal,
                 BodySum& friction);

// The same of one row over the coordinates of the body, as in Trees.
void add_row(const double* row, double weight, BodySum& sum);

void add_sum(const BodySum& term, BodySum& sum);

// trace(B^8)^(1/8) of B = inv(H) S; `inverse` as in Trees.
double bound_of_body(const BodySum& sum, const double* inverse);

}  // namespace dashpot
