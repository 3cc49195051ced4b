// Displacements that recover positions, against dense solutions of their equations.

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/mass_weighted.hpp"
#include "dashpot/solve/position_recovery.hpp"

namespace {

using namespace dashpot;
using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

constexpr double kTime = 0.002, kReach = 3e-4;

int failures = 0;
std::mt19937 generator(5);
double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
int below(int count) { return std::min(count - 1, static_cast<int>(uniform(0, count))); }

// A tree of `links`, each below any of those before it, and `bodies` that are free.
Trees random_trees(int links, int bodies) {
  Trees trees;
  std::vector<int> above(links, -1);
  for (int i = 1; i < links; ++i) above[i] = below(i);
  trees.append(0, links, false, above.data());
  double* factor = trees.factor.data();
  for (int k = 0; k < links; ++k) {
    factor[k * links + k] = std::exp(uniform(-2.0, 2.0));
    for (int i = above[k]; i >= 0; i = above[i]) factor[k * links + i] = uniform(-0.5, 0.5);
  }
  invert_inertia(trees, 0, factor);
  const int chain[] = {-1, 0, 1, 2, 3, 4};
  for (int body = 0; body < bodies; ++body) {
    std::vector<int> dofs(chain, chain + 6);
    const int first = links + 6 * body;
    for (int i = 1; i < 6; ++i) dofs[i] = first + i - 1;
    trees.append(first, 6, true, dofs.data());
    double* inverse = trees.inverse.data() + trees.tree.back().inverse;
    const double inverse_mass = std::exp(uniform(-2.0, 2.0));
    for (int i = 0; i < 3; ++i) inverse[i] = inverse_mass;
    const Eigen::Matrix3d root = Eigen::Matrix3d::Random();
    const Eigen::Matrix3d rotational = root * root.transpose() + Eigen::Matrix3d::Identity();
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) inverse[4 * (j + 1) + i] = rotational(i, j);
  }
  return trees;
}

struct Problem {
  Trees trees;
  Rows rows;
  RowData data;
  std::vector<int> tree, group;

  Island island() const {
    Island all;
    all.tree = {tree.data(), tree.data() + tree.size()};
    all.group = {group.data(), group.data() + group.size()};
    return all;
  }
};

// Fills in the sizes of a group whose Jacobian is there, and random springs; some rows but those of
// equalities are dashpots alone.
void finish_group(Problem& p, RowGroup& c) {
  append_mass_weighted(p.rows, c, p.trees);
  find_inverse_mass(p.rows, c, p.trees);
  for (int row = c.row; row < c.row + c.dim; ++row) {
    const double w = p.rows.inverse_mass[row];
    p.rows.typical_inverse_mass[row] = w * uniform(0.5, 2.0);
    p.rows.stiffness[row] = std::exp(uniform(0.0, 4.0)) / (w * kTime * kTime);
    if (c.kind != RowKind::kBilateral && uniform(0.0, 1.0) < 0.1) p.rows.stiffness[row] = 0.0;
  }
  p.group.push_back(static_cast<int>(p.group.size()));
}

// Rows over some coordinates of the tree and the first free body.
void add_sparse_rows(Problem& p, RowKind kind, int dim) {
  RowGroup& c = p.rows.append(kind, 0, dim, {0, 1});
  const Tree &tree = p.trees.tree[0], &body = p.trees.tree[1];
  for (int i = 0; i < tree.dof_count; ++i)
    if (uniform(0.0, 1.0) < 0.3 || i == 0) {
      p.rows.column.push_back(tree.begin + i);
      ++c.columns[0];
    }
  for (int i : {0, 1, 2, 4, 5, 6}) p.rows.column.push_back(body.begin + i);
  c.columns[1] = 6;
  for (int i = 0; i < dim * c.width(); ++i) p.rows.value.push_back(uniform(-1.0, 1.0));
  finish_group(p, c);
}

// A contact between two free bodies, or one and the ground.
void add_pair(Problem& p, int dim) {
  const int bodies = static_cast<int>(p.trees.tree.size()) - 1;
  const int first = below(bodies), second = below(bodies);
  std::array<int, 2> tree{1 + first, first == second ? -1 : 1 + second};
  RowGroup& c = p.rows.append(RowKind::kContact, 0, dim, tree);
  c.pair = static_cast<int>(p.rows.pair.size());
  PairGeometry& pair = p.rows.pair.emplace_back();
  const Eigen::Matrix3d frame =
      Eigen::Quaterniond(Eigen::Vector4d::Random().normalized()).toRotationMatrix();
  for (int i = 0; i < 9; ++i) pair.frame[i] = frame(i / 3, i % 3);
  for (int side = 0; side < 2; ++side) {
    if (tree[side] >= 0) pair.begin[side] = p.trees.tree[tree[side]].begin;
    for (double& arm : pair.arm[side]) arm = uniform(-0.3, 0.3);
  }
  finish_group(p, c);
}

Problem random_problem(int links, int bodies, int equalities, int contacts) {
  Problem p;
  p.trees = random_trees(links, bodies);
  p.tree.resize(p.trees.tree.size());
  std::iota(p.tree.begin(), p.tree.end(), 0);
  p.rows.reset(equalities + kMaxRows * 3 * contacts);
  for (int i = 0; i < equalities; ++i) add_sparse_rows(p, RowKind::kBilateral, 1);
  for (int i = 0; i < contacts; ++i) {
    const int dims[] = {1, 3, 4, 6};
    add_pair(p, dims[below(4)]);
    add_sparse_rows(p, RowKind::kContact, dims[below(4)]);
    add_sparse_rows(p, RowKind::kSlider, 1);
  }
  p.data.reset_rows(p.rows);
  for (double& x : p.data.deformation) x = uniform(-1e-3, 1e-3);
  for (char& sticks : p.data.sticking) sticks = uniform(0.0, 1.0) < 0.5;
  for (int i = 0; i < equalities; ++i) p.data.unstressed[i] = uniform(-1e-3, 1e-3);
  return p;
}

// Free bodies in a row, each held to the next by equalities.
Problem chain(int bodies) {
  Problem p;
  p.trees = random_trees(1, bodies);
  p.tree.resize(p.trees.tree.size());
  std::iota(p.tree.begin(), p.tree.end(), 0);
  p.rows.reset(3 * (bodies - 1));
  for (int i = 0; i < 3 * (bodies - 1); ++i) {
    const int first = 1 + i / 3;
    RowGroup& c = p.rows.append(RowKind::kBilateral, 0, 1, {first, first + 1});
    for (int side = 0; side < 2; ++side)
      for (int k : {0, 1, 2, 4, 5, 6}) {
        p.rows.column.push_back(p.trees.tree[first + side].begin + k);
        p.rows.value.push_back(uniform(-1.0, 1.0));
      }
    c.columns = {6, 6};
    finish_group(p, c);
  }
  p.data.reset_rows(p.rows);
  for (double& x : p.data.deformation) x = uniform(-1e-3, 1e-3);
  for (double& offset : p.data.unstressed) offset = uniform(-1e-3, 1e-3);
  return p;
}

void check_close(const Vector& value, const Vector& expected, double tolerance, const char* claim) {
  const double error = (value - expected).norm() / expected.norm();
  if (error <= tolerance) return;
  std::printf("%s: off by %g\n", claim, error);
  ++failures;
}

// d = inv(H) J' inv(A + R) t over all coordinates, by the definitions of position_recovery.hpp.
void check(const Problem& p, double tolerance) {
  RecoverySystem system;
  const Island island = p.island();
  system.reset(p.rows, p.trees, island, kReach, kTime, p.data);
  if (system.empty()) return;
  std::vector<double> displacement(p.trees.coordinates, 0.0);
  system.solve(displacement);

  const int n = p.trees.coordinates;
  Matrix inverse = Matrix::Zero(n, n);
  for (size_t tree = 0; tree < p.trees.tree.size(); ++tree) {
    const int begin = p.trees.tree[tree].begin;
    for (int j = begin; j < begin + p.trees.tree[tree].count; ++j) {
      Vector unit = Vector::Unit(n, j);
      add_response(p.trees, static_cast<int>(tree), unit.data() + begin,
                   inverse.col(j).data() + begin);
    }
  }
  std::vector<double> target, softness;
  std::vector<Vector> jacobian;
  for (int index : p.group) {
    const RowGroup& c = p.rows.group[index];
    const double x = p.data.deformation[c.row], offset = p.data.unstressed[index];
    const bool slips = !p.data.sticking[index];
    if (c.kind == RowKind::kContact && x >= 0.0) continue;
    for (int i = 0; i < c.dim; ++i) {
      const bool friction = c.kind == RowKind::kSlider || i > 0;
      if (friction && slips) continue;
      const bool equality = c.kind == RowKind::kBilateral;
      const double k = p.rows.stiffness[c.row + i];
      if (k == 0.0 && !equality) continue;
      Vector row(n);
      for (int j = 0; j < n; ++j) {
        double rate[kMaxRows];
        gather(p.rows, c, Vector::Unit(n, j).eval().data(), rate);
        row(j) = j < kGroundCoordinates ? 0.0 : rate[i];
      }
      jacobian.push_back(row);
      const double w = row.dot(inverse * row), typical = p.rows.typical_inverse_mass[c.row + i];
      softness.push_back(equality ? std::max(w / 100.0, typical - w) : 1.0 / (k * kTime * kTime));
      const bool recovers = equality && offset * (x - offset) < 0.0;
      target.push_back(recovers ? std::max(-kReach, std::min(offset, kReach)) : 0.0);
    }
  }
  const int rows = static_cast<int>(target.size());
  Matrix j(rows, n);
  for (int i = 0; i < rows; ++i) j.row(i) = jacobian[i];
  const Matrix apparent = j * inverse * j.transpose();
  const Vector r = Eigen::Map<Vector>(softness.data(), rows);
  const Vector e =
      (apparent + Matrix(r.asDiagonal())).ldlt().solve(Eigen::Map<Vector>(target.data(), rows));
  const Vector expected = inverse * j.transpose() * e;
  check_close(Eigen::Map<Vector>(displacement.data(), n), expected, tolerance, "displacement");
  check_close(Vector::Constant(1, system.square()), Vector::Constant(1, e.dot(apparent * e)),
              tolerance, "its energy");
  Vector shift(system.shift().size()), of_rows(system.shift().size());
  int i = 0;
  for (int index : system.groups()) {
    const RowGroup& c = p.rows.group[index];
    double rate[kMaxRows];
    gather(p.rows, c, expected.data(), rate);
    for (int k = 0; k < c.dim; ++k, ++i) {
      of_rows(i) = rate[k];
      shift(i) = system.shift()[i];
    }
  }
  check_close(shift, of_rows, tolerance, "shift of rows");
}

}  // namespace

int main() {
  // By factors, up to the rounding of springs a thousand times as stiff as masses.
  for (int i = 0; i < 200; ++i)
    check(random_problem(1 + below(30), 1 + below(8), 1 + below(8), below(5)), 1e-9);
  for (int i = 0; i < 3; ++i) check(chain(40), 1e-9);
  // By iterations, as many as there are rows at most, which end at a millionth.
  for (int i = 0; i < 50; ++i) check(random_problem(70, 12, 1 + below(8), below(2)), 1e-5);
  if (failures == 0) std::printf("displacements that recover positions: all claims hold\n");
  return failures == 0 ? 0 : 1;
}
