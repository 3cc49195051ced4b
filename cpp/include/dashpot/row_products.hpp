// Products of the whitened rows of one group with vectors. Pairs of free bodies and single ones,
// the bulk of any pile, have fixed sizes. In the header because they are the inner loop of a step.

#pragma once

#include <Eigen/Core>

#include "dashpot/rows.hpp"

namespace dashpot {

template <int First, int Second>
void gather_fixed(const double* rows, const RowGroup& c, const double* y, double* out) {
  Eigen::Matrix<double, First + Second, 1> v;
  v.template head<First>() = Eigen::Map<const Eigen::Matrix<double, First, 1>>(y + c.dof_begin[0]);
  v.template tail<Second>() =
      Eigen::Map<const Eigen::Matrix<double, Second, 1>>(y + c.dof_begin[1]);
  for (int i = 0; i < c.dim; ++i)
    out[i] = Eigen::Map<const Eigen::Matrix<double, First + Second, 1>>(rows + i * (First + Second))
                 .dot(v);
}

// out = Jw y: the rates of a group's rows for a whitened velocity.
inline void gather(const double* rows, const RowGroup& c, const double* y, double* out) {
  if (c.dof_count[0] == 6 && c.dof_count[1] == 6) return gather_fixed<6, 6>(rows, c, y, out);
  if (c.dof_count[0] == 6 && c.dof_count[1] == 0) return gather_fixed<6, 0>(rows, c, y, out);
  if (c.dof_count[0] == 0 && c.dof_count[1] == 6) return gather_fixed<0, 6>(rows, c, y, out);
  using Vector = Eigen::Map<const Eigen::VectorXd>;
  for (int i = 0; i < c.dim; ++i, rows += c.stride)
    out[i] = Vector(rows, c.dof_count[0]).dot(Vector(y + c.dof_begin[0], c.dof_count[0])) +
             Vector(rows + c.dof_count[0], c.dof_count[1])
                 .dot(Vector(y + c.dof_begin[1], c.dof_count[1]));
}

template <int First, int Second>
void scatter_fixed(const double* rows, const RowGroup& c, const double* factor, double* y) {
  Eigen::Matrix<double, First + Second, 1> sum;
  sum.setZero();
  for (int i = 0; i < c.dim; ++i)
    sum += factor[i] *
           Eigen::Map<const Eigen::Matrix<double, First + Second, 1>>(rows + i * (First + Second));
  Eigen::Map<Eigen::Matrix<double, First, 1>>(y + c.dof_begin[0]) += sum.template head<First>();
  Eigen::Map<Eigen::Matrix<double, Second, 1>>(y + c.dof_begin[1]) += sum.template tail<Second>();
}

// y += Jw' factor.
inline void scatter(const double* rows, const RowGroup& c, const double* factor, double* y) {
  if (c.dof_count[0] == 6 && c.dof_count[1] == 6) return scatter_fixed<6, 6>(rows, c, factor, y);
  if (c.dof_count[0] == 6 && c.dof_count[1] == 0) return scatter_fixed<6, 0>(rows, c, factor, y);
  if (c.dof_count[0] == 0 && c.dof_count[1] == 6) return scatter_fixed<0, 6>(rows, c, factor, y);
  using Vector = Eigen::Map<const Eigen::VectorXd>;
  using Target = Eigen::Map<Eigen::VectorXd>;
  for (int i = 0; i < c.dim; ++i, rows += c.stride) {
    Target(y + c.dof_begin[0], c.dof_count[0]) += factor[i] * Vector(rows, c.dof_count[0]);
    Target(y + c.dof_begin[1], c.dof_count[1]) +=
        factor[i] * Vector(rows + c.dof_count[0], c.dof_count[1]);
  }
}

}  // namespace dashpot
