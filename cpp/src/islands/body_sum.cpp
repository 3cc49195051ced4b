#include "dashpot/islands/body_sum.hpp"

#include <cmath>

#include "dashpot/lanes/instruction_sets.hpp"

namespace dashpot {

namespace {

constexpr int kSize = 6;  // of B

[[gnu::always_inline]] inline Lanes cross(const Lanes& a, const Lanes& b) {
  return yzx(a * yzx(b) - yzx(a) * b);
}

[[gnu::always_inline]] inline Lanes three(const double* values) {
  return Lanes{values[0], values[1], values[2], 0.0};
}

// sum += a b'.
[[gnu::always_inline]] inline void add_product(const Lanes& a, const Lanes& b, Lanes (&sum)[3]) {
  for (int j = 0; j < 3; ++j) sum[j] += a * b[j];
}

[[gnu::always_inline]] inline void add_row(const PairGeometry& pair, const Lanes& arm, int row,
                                           double weight, BodySum& sum) {
  const Lanes axis = three(pair.frame.data() + 3 * (row % 3));
  const Lanes weighted = weight * axis;
  if (row >= 3) return add_product(axis, weighted, sum.angular);
  const Lanes moment = cross(arm, axis);
  add_product(axis, weighted, sum.linear);
  add_product(moment, weighted, sum.mixed);
  add_product(moment, weight * moment, sum.angular);
}

// The rows of its columns, three linear ones and three angular ones, each with a zero.
struct Matrix {
  Lanes linear[kSize], angular[kSize];
};

[[gnu::always_inline]] inline Matrix product(const Matrix& a, const Matrix& b) {
  Matrix c;
  for (int j = 0; j < kSize; ++j) {
    Lanes linear{}, angular{};
    for (int k = 0; k < kSize; ++k) {
      const double entry = k < 3 ? b.linear[j][k] : b.angular[j][k - 3];
      linear += a.linear[k] * entry;
      angular += a.angular[k] * entry;
    }
    c.linear[j] = linear;
    c.angular[j] = angular;
  }
  return c;
}

// trace(A B) of three columns each.
[[gnu::always_inline]] inline double trace_of_product(const Lanes* a, const Lanes* b) {
  Lanes row[kLanes] = {b[0], b[1], b[2], Lanes{}};
  transpose(row);
  const Lanes sum = a[0] * row[0] + a[1] * row[1] + a[2] * row[2];
  return sum[0] + sum[1] + sum[2];
}

}  // namespace

DASHPOT_VECTOR_CLONES
void add_rows(const PairGeometry& pair, int side, int first, int dim, const double* weight,
              BodySum& sum) {
  const Lanes arm = three(pair.arm[side].data());
  BodySum added = sum;
  for (int i = 0; i < dim; ++i) add_row(pair, arm, first + i, weight[i], added);
  sum = added;
}

DASHPOT_VECTOR_CLONES
void add_contact(const PairGeometry& pair, int side, int dim, const double* weight, BodySum& normal,
                 BodySum& friction) {
  const Lanes arm = three(pair.arm[side].data());
  add_row(pair, arm, 0, weight[0], normal);
  BodySum added = friction;
  for (int i = 1; i < dim; ++i) add_row(pair, arm, i, weight[i], added);
  friction = added;
}

DASHPOT_VECTOR_CLONES
void add_row(const double* row, double weight, BodySum& sum) {
  const Lanes linear = load_lanes(row), angular = load_lanes(row + kLanes);
  add_product(linear, weight * linear, sum.linear);
  add_product(angular, weight * linear, sum.mixed);
  add_product(angular, weight * angular, sum.angular);
}

void add_sum(const BodySum& term, BodySum& sum) {
  for (int j = 0; j < 3; ++j) {
    sum.linear[j] += term.linear[j];
    sum.mixed[j] += term.mixed[j];
    sum.angular[j] += term.angular[j];
  }
}

DASHPOT_VECTOR_CLONES
double bound_of_body(const BodySum& sum, const double* inverse) {
  const Lanes inverse_mass = load_lanes(inverse);
  Lanes inverse_inertia[3];
  for (int k = 0; k < 3; ++k) inverse_inertia[k] = load_lanes(inverse + 4 * (k + 1));
  const auto turn = [&](const Lanes& moment) __attribute__((always_inline)) {
    return inverse_inertia[0] * moment[0] + inverse_inertia[1] * moment[1] +
           inverse_inertia[2] * moment[2];
  };
  Lanes above[kLanes] = {sum.mixed[0], sum.mixed[1], sum.mixed[2], Lanes{}};
  transpose(above);
  Matrix b;
  double trace = 0.0;
  for (int j = 0; j < 3; ++j) {
    b.linear[j] = inverse_mass * sum.linear[j];
    b.angular[j] = turn(sum.mixed[j]);
    b.linear[3 + j] = inverse_mass * above[j];
    b.angular[3 + j] = turn(sum.angular[j]);
    trace += b.linear[j][j] + b.angular[3 + j][j];
  }
  if (trace == 0.0) return 0.0;
  const double scale = 1.0 / trace;
  for (int j = 0; j < kSize; ++j) {
    b.linear[j] *= scale;
    b.angular[j] *= scale;
  }
  const Matrix square = product(b, b), fourth = product(square, square);
  const double eighth = trace_of_product(fourth.linear, fourth.linear) +
                        2.0 * trace_of_product(fourth.linear + 3, fourth.angular) +
                        trace_of_product(fourth.angular + 3, fourth.angular + 3);
  return trace * std::sqrt(std::sqrt(std::sqrt(eighth)));
}

}  // namespace dashpot
