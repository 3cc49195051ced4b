// Bounds of contacts on free bodies against dense sums and products.

#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <random>

#include "dashpot/islands/body_sum.hpp"

namespace {

using namespace dashpot;
using Eigen::Matrix3d, Eigen::Vector3d;
using Matrix = Eigen::Matrix<double, 6, 6>;
using Row = Eigen::Matrix<double, 1, 6>;

int failures = 0;

void check_close(double value, double expected, const char* claim) {
  // Rounding of products of matrices whose entries differ by at most 1e3.
  if (std::abs(value - expected) <= 1e-11 * std::abs(expected)) return;
  std::printf("%s: %.17g, expected %.17g\n", claim, value, expected);
  ++failures;
}

std::mt19937 generator(5);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
Vector3d random_vector() { return {uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)}; }

PairGeometry random_pair() {
  PairGeometry pair;
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(uniform(0, 3), random_vector().normalized()));
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pair.frame.data()) = turn.matrix();
  for (auto& arm : pair.arm) Eigen::Map<Vector3d>(arm.data()) = random_vector();
  return pair;
}

Row row_of(const PairGeometry& pair, int side, int i) {
  const Vector3d axis(pair.frame.data() + 3 * (i % 3)), arm(pair.arm[side].data());
  Row row = Row::Zero();
  if (i < 3) row << axis.transpose(), arm.cross(axis).transpose();
  if (i >= 3) row.tail<3>() = axis.transpose();
  return row;
}

double dense_bound(const Matrix& inverse, const Matrix& sum) {
  const Matrix b = inverse * sum, fourth = b * b * b * b;
  return std::pow((fourth * fourth).trace(), 0.125);
}

// Normals in one sum and friction in another, with a sparse row in that, of a body with `contacts`.
void check_body(int contacts, int dim) {
  double inverse[16] = {};
  Matrix dense_inverse = Matrix::Zero();
  const double inverse_mass = std::exp(uniform(-2, 2));
  Matrix3d root;
  for (int i = 0; i < 3; ++i) root.col(i) = random_vector();
  const Matrix3d inverse_inertia = root * root.transpose() + 0.1 * Matrix3d::Identity();
  for (int i = 0; i < 3; ++i) {
    inverse[i] = dense_inverse(i, i) = inverse_mass;
    for (int j = 0; j < 3; ++j)
      inverse[4 * (j + 1) + i] = dense_inverse(3 + i, 3 + j) = inverse_inertia(i, j);
  }
  BodySum normal, friction;
  Matrix dense_normal = Matrix::Zero(), dense_friction = Matrix::Zero();
  for (int k = 0; k < contacts; ++k) {
    const PairGeometry pair = random_pair();
    const int side = k % 2;
    double weight[kMaxRows];
    for (int i = 0; i < dim; ++i) {
      weight[i] = uniform(0.1, 3.0);
      const Row row = row_of(pair, side, i);
      (i == 0 ? dense_normal : dense_friction) += weight[i] * row.transpose() * row;
    }
    add_contact(pair, side, dim, weight, normal, friction);
    add_rows(pair, side, 0, dim, weight, friction);
    for (int i = 0; i < dim; ++i) {
      const Row row = row_of(pair, side, i);
      dense_friction += weight[i] * row.transpose() * row;
    }
  }
  const Row sparse = Row::Random();
  double of_body[kBodyCoordinates] = {};
  for (int k = 0; k < 6; ++k) of_body[k < 3 ? k : k + 1] = sparse[k];
  add_row(of_body, 1.0, friction);
  dense_friction += sparse.transpose() * sparse;
  check_close(bound_of_body(normal, inverse), dense_bound(dense_inverse, dense_normal),
              "bound of normals");
  add_sum(normal, friction);
  check_close(bound_of_body(friction, inverse),
              dense_bound(dense_inverse, dense_normal + dense_friction), "bound of all rows");
}

}  // namespace

int main() {
  double inverse[16] = {};
  check_close(bound_of_body(BodySum(), inverse), 0.0, "bound of no rows");
  for (int contacts = 1; contacts <= 8; ++contacts)
    for (int dim : {1, 3, 4, 6}) check_body(contacts, dim);
  return failures == 0 ? 0 : 1;
}
