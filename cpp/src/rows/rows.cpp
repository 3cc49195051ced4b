#include "dashpot/rows/rows.hpp"

#include <cmath>

#include "dashpot/rows/mass_weighted.hpp"

namespace dashpot {

namespace {

// Fraction of the inverse mass along a tangent below which that of a normal is singular: of free
// bodies it is a quarter and more.
constexpr double kSideways = 0.1;

double dot(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// a x b, added to `sum` times `sign`.
void add_cross(const double* a, const double* b, double sign, double* sum) {
  sum[0] += sign * (a[1] * b[2] - a[2] * b[1]);
  sum[1] += sign * (a[2] * b[0] - a[0] * b[2]);
  sum[2] += sign * (a[0] * b[1] - a[1] * b[0]);
}

double side_sign(int side) { return side == 0 ? -1.0 : 1.0; }

// `sum` and moment' inv(I) moment, of a row's moment about the centre of mass of a free body.
double inverse_mass_of_moment(const double* moment, const double* inverse, double sum) {
  for (int j = 0; j < 3; ++j) sum += moment[j] * dot(moment, inverse + 4 * (j + 1));
  return sum;
}

// J inv(H) J' of all rows of a pair over one of its free bodies.
void pair_inverse_mass(const PairGeometry& pair, int dim, int side, const double* inverse,
                       double* out) {
  for (int i = 0; i < dim; ++i) {
    const double* axis = pair.frame.data() + 3 * (i % 3);
    if (i < 3) {
      double moment[3] = {};
      add_cross(pair.arm[side].data(), axis, 1.0, moment);
      out[i] = inverse_mass_of_moment(moment, inverse, inverse[0] * dot(axis, axis));
    } else {
      out[i] = inverse_mass_of_moment(axis, inverse, 0.0);
    }
  }
}

// The same of all rows of a group over their sparse entries for a free body, whose columns are the
// `count` from `first` on.
void sparse_inverse_mass(const Rows& rows, const RowGroup& c, int first, int count,
                         const Tree& tree, const double* inverse, double* sum) {
  const double* value = rows.value.data() + c.value + first;
  const int* column = rows.column.data() + c.column + first;
  for (int i = 0; i < c.dim; ++i, value += c.width()) {
    double row[kBodyCoordinates] = {};
    for (int k = 0; k < count; ++k) row[column[k] - tree.begin] = value[k];
    sum[i] = inverse[0] * dot(row, row);
    for (int j = 0; j < 3; ++j) sum[i] += row[4 + j] * dot(row + 4, inverse + 4 * (j + 1));
  }
}

// The same of a row of one coordinate, which is that of its column `index`.
double joint_inverse_mass(const Rows& rows, const RowGroup& c, int index, int tree,
                          const Trees& trees) {
  const int coordinate = rows.column[c.column + index] - trees.tree[tree].begin;
  const double value = rows.value[c.value + index];
  return value * value * inverse_diagonal(trees, tree, coordinate);
}

}  // namespace

void Rows::reset(int count) {
  group.clear();
  equality.clear();
  on_surface.clear();
  column.clear();
  value.clear();
  weighted_column.clear();
  weighted_value.clear();
  appended = 0;
  for (auto* array : {&inverse_mass, &typical_inverse_mass, &stiffness, &damping, &friction})
    array->assign(count, 0.0);
  tree_inverse_mass.assign(count, {0.0, 0.0});
}

RowGroup& Rows::append(RowKind kind, int input, int dim, std::array<int, 2> tree) {
  if (tree[0] == tree[1]) tree[1] = -1;
  RowGroup& c = group.emplace_back();
  c.kind = kind;
  c.first_of_pair = static_cast<int>(group.size()) - 1;
  if (kind == RowKind::kBilateral) equality.push_back(c.first_of_pair);
  c.input = input;
  c.dim = dim;
  c.row = appended;
  c.tree = tree;
  c.column = static_cast<int>(column.size());
  c.value = static_cast<int>(value.size());
  appended += dim;
  return c;
}

std::array<double, 6> pair_row(const PairGeometry& pair, int i, int side) {
  std::array<double, 6> row{};
  const double* direction = pair.frame.data() + 3 * (i % 3);
  const double sign = side_sign(side);
  if (i < 3) {
    for (int j = 0; j < 3; ++j) row[j] = sign * direction[j];
    add_cross(pair.arm[side].data(), direction, sign, row.data() + 3);
  } else {
    for (int j = 0; j < 3; ++j) row[3 + j] = sign * direction[j];
  }
  return row;
}

void gather(const Rows& rows, const RowGroup& c, int dim, const double* motion, double* out) {
  if (c.pair < 0) {
    const int* column = rows.column.data() + c.column;
    const double* value = rows.value.data() + c.value;
    const int width = c.width();
    for (int i = 0; i < dim; ++i, value += width) {
      double sum = 0.0;
      for (int k = 0; k < width; ++k) sum += value[k] * motion[column[k]];
      out[i] = sum;
    }
    return;
  }
  const PairGeometry& pair = rows.pair[c.pair];
  double linear[3] = {}, angular[3] = {};
  for (int side = 0; side < 2; ++side) {
    const double* body = motion + pair.begin[side];
    const double sign = side_sign(side);
    for (int j = 0; j < 3; ++j) {
      linear[j] += sign * body[j];
      angular[j] += sign * body[4 + j];
    }
    add_cross(body + 4, pair.arm[side].data(), sign, linear);
  }
  for (int i = 0; i < dim; ++i)
    out[i] = dot(pair.frame.data() + 3 * (i % 3), i < 3 ? linear : angular);
}

void scatter(const Rows& rows, const RowGroup& c, int dim, const double* impulse, double* force) {
  if (c.pair < 0) {
    const int* column = rows.column.data() + c.column;
    const double* value = rows.value.data() + c.value;
    const int width = c.width();
    for (int i = 0; i < dim; ++i, value += width)
      for (int k = 0; k < width; ++k) force[column[k]] += value[k] * impulse[i];
    return;
  }
  const PairGeometry& pair = rows.pair[c.pair];
  double linear[3] = {}, angular[3] = {};
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < 3; ++j)
      (i < 3 ? linear : angular)[j] += pair.frame[3 * (i % 3) + j] * impulse[i];
  for (int side = 0; side < 2; ++side) {
    double* body = force + pair.begin[side];
    const double sign = side_sign(side);
    for (int j = 0; j < 3; ++j) {
      body[j] += sign * linear[j];
      body[4 + j] += sign * angular[j];
    }
    add_cross(pair.arm[side].data(), linear, sign, body + 4);
  }
}

std::array<double, 3> along_frame(const ContactInput& contact,
                                  const std::array<double, 3>& vector) {
  std::array<double, 3> along{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) along[i] += contact.frame[3 * i + k] * vector[k];
  return along;
}

void append_ground_motion(Rows& rows, int coordinate, const double* rate) {
  RowGroup& c = rows.group.back();
  const int width = c.width();
  c.ground = coordinate;
  if (coordinate == kSurfaceCoordinate)
    rows.on_surface.push_back(static_cast<int>(rows.group.size()) - 1);
  rows.column.push_back(coordinate);
  rows.value.resize(c.value + c.dim * (width + 1));
  double* value = rows.value.data() + c.value;
  for (int i = c.dim - 1; i >= 0; --i) {
    std::copy_backward(value + i * width, value + (i + 1) * width, value + i * (width + 1) + width);
    value[i * (width + 1) + width] = rate[i];
  }
}

double turning_rate(const Rows& rows, const RowGroup& c) {
  return c.ground == kTurningCoordinate ? rows.value[c.value + c.width() - 1] : 0.0;
}

void stop_turning(Rows& rows, const RowGroup& c) {
  if (c.ground == kTurningCoordinate) rows.value[c.value + c.width() - 1] = 0.0;
}

double surface_work(const Rows& rows, const RowGroup& c, const double* impulse) {
  double work = 0.0;
  if (c.ground == kSurfaceCoordinate)
    for (int i = 0; i < c.dim; ++i)
      work -= impulse[i] * rows.value[c.value + (i + 1) * c.width() - 1];
  return work;
}

int more_mobile(const Rows& rows, const RowGroup& c, int i) {
  const double* w = rows.inverse_mass.data() + c.row + i;
  return w[1] > w[0] ? i + 1 : i;
}

double bearable_compression(const Rows& rows, const RowGroup& c, double recovery_speed) {
  const double k = rows.stiffness[c.row];
  const double w = std::max(rows.inverse_mass[c.row], rows.typical_inverse_mass[c.row]);
  return std::max(recovery_speed / std::sqrt(k * w), c.soft_load / k);
}

double recovery_speed_along(const Rows& rows, const RowGroup& c, double recovery_speed) {
  if (c.kind != RowKind::kContact || c.dim < 3 || std::isinf(recovery_speed)) return recovery_speed;
  const double w = rows.inverse_mass[c.row];
  const double sideways = kSideways * rows.inverse_mass[more_mobile(rows, c, 1)];
  return w < sideways ? recovery_speed * std::sqrt(w / sideways) : recovery_speed;
}

void find_inverse_mass(Rows& rows, RowGroup& c, const Trees& trees) {
  int column = 0;
  for (int side = 0; side < 2; ++side) {
    double part[kMaxRows] = {};
    if (c.tree[side] >= 0) {
      const Tree& tree = trees.tree[c.tree[side]];
      const double* inverse = trees.inverse.data() + tree.inverse;
      if (c.pair >= 0)
        pair_inverse_mass(rows.pair[c.pair], c.dim, side, inverse, part);
      else if (tree.free_body)
        sparse_inverse_mass(rows, c, column, c.columns[side], tree, inverse, part);
      else if (c.is_of_one_coordinate(side))
        part[0] = joint_inverse_mass(rows, c, column, c.tree[side], trees);
      else
        weight_by_mass(rows, c, side, trees, part);
      column += c.columns[side];
    }
    for (int i = 0; i < c.dim; ++i) rows.tree_inverse_mass[c.row + i][side] = part[i];
  }
  for (int row = c.row; row < c.row + c.dim; ++row)
    rows.inverse_mass[row] = rows.tree_inverse_mass[row][0] + rows.tree_inverse_mass[row][1];
  // Where bodies cannot move along the normal or a tangent, what the other rows leave there through
  // the error of the contact frame is no motion.
  double largest = 0.0;
  const int linear = std::min(c.dim, 3);
  for (int i = 0; i < linear; ++i) largest = std::max(largest, rows.inverse_mass[c.row + i]);
  const double least = kDirection * kDirection * largest;
  for (int row = c.row; row < c.row + linear; ++row) {
    if (rows.inverse_mass[row] >= least) continue;
    rows.inverse_mass[row] = 0.0;
    rows.tree_inverse_mass[row] = {0.0, 0.0};
  }
}

}  // namespace dashpot
