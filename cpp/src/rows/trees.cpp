#include "dashpot/rows/trees.hpp"

#include <cmath>
#include <string>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/lanes.hpp"

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
      : row(trees.row_begin.data() + t.dof_begin),
        last_below(trees.last_below.data() + t.dof_begin),
        path_begin(trees.path_begin.data() + t.dof_begin),
        path(trees.path.data()) {}
  // Those above one, from the nearest up.
  Range of(int dof) const { return {path + path_begin[dof], path + path_begin[dof + 1]}; }

  // The nearest above one, or -1; the last one above it, or itself.
  int next(int dof) const { return of(dof).first == of(dof).last ? -1 : *of(dof).first; }
  int last_of(int dof) const { return of(dof).first == of(dof).last ? dof : of(dof).last[-1]; }

  const int *row, *last_below, *path_begin, *path;
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
// over the columns of what is below it, and then inv(L) what rows above leave, from the first.
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

void Trees::append(int dof_begin, int dof_count, bool free_body, const int* above_dofs,
                   bool is_sparse) {
  Tree t;
  t.dof_begin = dof_begin;
  t.dof_count = dof_count;
  if (free_body)
    coordinates = (coordinates + kBodyCoordinates - 1) / kBodyCoordinates * kBodyCoordinates;
  t.begin = coordinates;
  t.count = free_body ? kBodyCoordinates : padded(dof_count);
  t.free_body = free_body;
  t.sparse = is_sparse;
  t.inverse = static_cast<int>(inverse.size());
  coordinates += t.count;
  damping.resize(coordinates, 0.0);
  for (auto* array : {&stiffness, &whole_acceleration}) array->resize(coordinates, 0.0);
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
  int entries = 0;
  for (int i = 0; i < dof_count; ++i) {
    const int path_end = path_begin[dof_begin + i + 1];
    const int first = path_begin[dof_begin + i] < path_end ? path[path_end - 1] : i;
    row_begin.push_back(is_sparse ? entries - first : i * dof_count);
    entries += i - first + 1;
  }
  const int size = is_sparse ? padded(entries) : t.count * t.count;
  for (auto* array : {&inverse, &factor, &cross_damping}) array->resize(t.inverse + size, 0.0);
  sparse.emplace_back();
  sparse_is_known.push_back(0);
}

void add_response(const Trees& trees, int tree, const double* force, double* acceleration) {
  const Tree& t = trees.tree[tree];
  if (t.free_body || t.sparse) return add_solution(trees, tree, force, acceleration);
  respond(trees.inverse.data() + t.inverse, force, t.dof_count, t.count, acceleration);
}

void add_solution(const Trees& trees, int tree, const double* force, double* acceleration) {
  const Tree& t = trees.tree[tree];
  if (t.free_body) {
    const double* column = trees.inverse.data() + t.inverse;
    for (int i = 0; i < 3; ++i) acceleration[i] += column[i] * force[i];
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) acceleration[4 + i] += column[4 * (j + 1) + i] * force[4 + j];
    return;
  }
  if (trees.sparse[tree]) return trees.sparse[tree]->add_solution(force, acceleration);
  if (t.diagonal) {
    const double* root = trees.inverse_root.data() + t.begin;
    for (int i = 0; i < t.dof_count; ++i) acceleration[i] += force[i] * root[i] * root[i];
    return;
  }
  thread_local std::vector<double> solution;  // a step allocates nothing
  solution.assign(force, force + t.dof_count);
  solve_inertia(trees, tree, trees.factor.data() + t.inverse, solution.data());
  for (int i = 0; i < t.dof_count; ++i) acceleration[i] += solution[i];
}

void solve_effective(const Trees& trees, int tree, double* x) {
  const Tree& t = trees.tree[tree];
  if (!trees.sparse[tree]) return solve_inertia(trees, tree, trees.factor.data() + t.inverse, x);
  std::vector<double> force(x, x + t.dof_count);
  std::fill_n(x, t.dof_count, 0.0);
  trees.sparse[tree]->add_solution(force.data(), x);
}

// Of the unit vector along i, divided by L' and the roots of D, the square.
double inverse_diagonal(const Trees& trees, int tree, int i) {
  const Tree& t = trees.tree[tree];
  if (!t.sparse) return trees.inverse[t.inverse + i * (t.count + 1)];
  const Above above(trees, t);
  const double* factor = trees.factor.data() + t.inverse;
  const int first = above.last_of(i);
  thread_local std::vector<double> unit;
  unit.assign(i - first + 1, 0.0);
  unit.back() = 1.0;
  double sum = 0.0;
  for (int k = i; k >= 0; k = above.next(k)) {
    const double y = unit[k - first];
    for (int j : above.of(k)) unit[j - first] -= factor[above.row[k] + j] * y;
    sum += y * y / factor[above.row[k] + k];
  }
  return sum;
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
    double* row = inertia + above.row[k];
    if (!(row[k] > 0.0)) return false;
    Above::Range rest = above.of(k);
    while (rest.first != rest.last) {
      const int i = *rest.first++;
      const double entry = row[i] / row[k];
      double* to = inertia + above.row[i];
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
    for (int i : above.of(k)) x[i] -= factor[above.row[k] + i] * x[k];
  for (int k = 0; k < n; ++k) {
    x[k] /= factor[above.row[k] + k];
    for (int i : above.of(k)) x[k] -= factor[above.row[k] + i] * x[i];
  }
}

double inertia_form(const Trees& trees, int tree, const double* factor, const double* x) {
  const Tree& t = trees.tree[tree];
  const int n = t.dof_count;
  const Above above(trees, t);
  double sum = 0.0;
  for (int k = 0; k < n; ++k) {
    double y = x[k];
    for (int i : above.of(k)) y += factor[above.row[k] + i] * x[i];
    sum += factor[above.row[k] + k] * y * y;
  }
  return sum;
}

void invert_inertia(Trees& trees, int tree, const double* factor) {
  Tree& t = trees.tree[tree];
  const Above above(trees, t);
  if (!t.sparse) invert(factor, above, t.dof_count, t.count, trees.inverse.data() + t.inverse);
  t.diagonal = t.sparse;
  for (int i = 0; i < t.dof_count; ++i) {
    trees.inverse_root[t.begin + i] = 1.0 / std::sqrt(factor[above.row[i] + i]);
    for (int j : above.of(i)) t.diagonal = t.diagonal && factor[above.row[i] + j] == 0.0;
  }
}

}  // namespace dashpot
