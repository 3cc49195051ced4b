#include "dashpot/rows/trees.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/lanes.hpp"
#include "dashpot/rows/divergence.hpp"

namespace dashpot {

namespace {

// Degrees of freedom of a tree in numbers from its first.
struct Above {
  struct Range {
    const int *first, *last;
    const int* begin() const { return first; }
    const int* end() const { return last; }
  };

  Above(const Trees& trees, const Tree& t)
      : last_below(trees.last_below.data() + t.dof_begin),
        path_begin(trees.path_begin.data() + t.dof_begin),
        path(trees.path.data()) {}
  // Those above one, from the nearest up.
  Range of(int dof) const { return {path + path_begin[dof], path + path_begin[dof + 1]}; }

  const int *last_below, *path_begin, *path;
};

// response += inv(H) force, the columns of inv(H) `count` apart.
DASHPOT_VECTOR_CLONES
void respond(const double* inverse, const double* force, int n, int count, double* response) {
  for_each_block(
      count, [=](int first, auto width) __attribute__((always_inline)) {
        Lanes sum[width()];
        load_block(response + first, sum);
        for (int j = 0; j < n; ++j) add_scaled(inverse + j * count + first, force[j], sum);
        store_block(sum, response + first);
      });
}

// inverse = inv(L' D L), symmetric, columns `count` apart, a multiple of four. Of the unit matrix,
// inv(L') is what rows leave that are taken off the rows above them, from the last one up, each
// over the columns of what is below it, and then inv(L) what rows above leave, from the first one
// down.
DASHPOT_VECTOR_CLONES
void invert(const double* factor, const Above& above, int n, int count, double* inverse) {
  std::fill_n(inverse, count * count, 0.0);
  for (int k = n - 1; k >= 0; --k) {
    double* row = inverse + k * count;
    row[k] = 1.0;
    // All other entries are zero so far.
    const int first_filled = k / kLanes * kLanes, end = above.last_below[k] + 1;
    for (int i : above.of(k)) {
      const double scale = -factor[k * n + i];
      double* to = inverse + i * count;
      for (int j = first_filled; j < end; j += kLanes)
        store_lanes(load_lanes(to + j) + load_lanes(row + j) * scale, to + j);
    }
    const double scale = 1.0 / factor[k * n + k];
    for (int j = first_filled; j < end; j += kLanes)
      store_lanes(load_lanes(row + j) * scale, row + j);
  }
  for (int k = 0; k < n; ++k)
    for_each_block(
        count, [ =, &above ](int first, auto width) __attribute__((always_inline)) {
          double* row = inverse + k * count + first;
          Lanes rest[width()];
          load_block(row, rest);
          for (int i : above.of(k))
            add_scaled(inverse + i * count + first, -factor[k * n + i], rest);
          store_block(rest, row);
        });
}

}  // namespace

void Trees::append(int dof_begin, int dof_count, bool free_body, const int* above_dofs) {
  Tree t;
  t.dof_begin = dof_begin;
  t.dof_count = dof_count;
  if (free_body)
    coordinates = (coordinates + kBodyCoordinates - 1) / kBodyCoordinates * kBodyCoordinates;
  t.begin = coordinates;
  t.count = free_body ? kBodyCoordinates : padded(dof_count);
  t.free_body = free_body;
  t.inverse = static_cast<int>(inverse.size());
  coordinates += t.count;
  inverse.resize(inverse.size() + t.count * t.count, 0.0);
  factor.resize(inverse.size(), 0.0);
  cross_damping.resize(inverse.size(), 0.0);
  damping.resize(coordinates, 0.0);
  stiffness.resize(coordinates, 0.0);
  inverse_root.resize(coordinates, 0.0);
  tree.push_back(t);
  above.insert(above.end(), above_dofs, above_dofs + dof_count);
  joint_damping.resize(above.size(), 0.0);
  for (int i = 0; i < dof_count; ++i) {
    last_below.push_back(i);
    for (int dof = above[dof_begin + i]; dof >= 0; dof = above[dof]) {
      path.push_back(dof - dof_begin);
      last_below[dof] = i;
    }
    path_begin.push_back(static_cast<int>(path.size()));
  }
}

double mean_of_trees(const std::array<int, 2>& tree, const std::vector<double>& value) {
  double sum = 0.0;
  int count = 0;
  for (int index : tree) {
    if (index < 0) continue;
    sum += value[index];
    ++count;
  }
  return count > 0 ? sum / count : 0.0;
}

void add_response(const Trees& trees, int tree, const double* force, double* acceleration) {
  const Tree& t = trees.tree[tree];
  const double* column = trees.inverse.data() + t.inverse;
  if (t.free_body) {
    for (int i = 0; i < 3; ++i) acceleration[i] += column[i] * force[i];
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) acceleration[4 + i] += column[4 * (j + 1) + i] * force[4 + j];
    return;
  }
  respond(column, force, t.dof_count, t.count, acceleration);
}

void check_bounded(const Tree& tree, const double* motion, double largest) {
  for (int i = tree.begin; i < tree.begin + tree.count; ++i)
    if (!(std::abs(motion[i]) <= largest))
      throw DivergenceError("contact forces diverged at the kinematic tree of degree of freedom " +
                            std::to_string(tree.dof_begin) +
                            "; data are as they were before the step");
}

bool factor_inertia(const Trees& trees, int tree, double* inertia) {
  const Tree& t = trees.tree[tree];
  const int n = t.dof_count;
  const Above above(trees, t);
  for (int k = n - 1; k >= 0; --k) {
    double* row = inertia + k * n;
    if (!(row[k] > 0.0)) return false;
    Above::Range rest = above.of(k);
    while (rest.first != rest.last) {
      const int i = *rest.first++;
      const double entry = row[i] / row[k];
      double* to = inertia + i * n;
      to[i] -= entry * row[i];
      for (int j : rest) to[j] -= entry * row[j];
      row[i] = entry;
    }
  }
  return true;
}

void solve_inertia(const Trees& trees, int tree, const double* factor, double* x) {
  const Tree& t = trees.tree[tree];
  const int n = t.dof_count;
  const Above above(trees, t);
  for (int k = n - 1; k >= 0; --k)
    for (int i : above.of(k)) x[i] -= factor[k * n + i] * x[k];
  for (int k = 0; k < n; ++k) {
    x[k] /= factor[k * n + k];
    for (int i : above.of(k)) x[k] -= factor[k * n + i] * x[i];
  }
}

double inertia_form(const Trees& trees, int tree, const double* factor, const double* x) {
  const Tree& t = trees.tree[tree];
  const int n = t.dof_count;
  const Above above(trees, t);
  double sum = 0.0;
  for (int k = 0; k < n; ++k) {
    double y = x[k];
    for (int i : above.of(k)) y += factor[k * n + i] * x[i];
    sum += factor[k * n + k] * y * y;
  }
  return sum;
}

void invert_inertia(Trees& trees, int tree, const double* factor) {
  const Tree& t = trees.tree[tree];
  invert(factor, Above(trees, t), t.dof_count, t.count, trees.inverse.data() + t.inverse);
  for (int i = 0; i < t.dof_count; ++i)
    trees.inverse_root[t.begin + i] = 1.0 / std::sqrt(factor[i * (t.dof_count + 1)]);
}

}  // namespace dashpot
