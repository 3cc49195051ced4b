// Kinematic trees in motion coordinates, and their effective inverse inertia.
//
// The contact solver works in motion coordinates xi, one range of them for each tree:
//
//     a free body:       velocity of the centre of mass (3), 0, angular velocity (3), 0; world axes
//     any other tree:    its generalized velocities, then zeros up to a multiple of four
//
// H is the effective inertia in these coordinates: inertia plus what the integrator treats
// implicitly. For a free body inv(H) is 1/m and the inverse rotational inertia, so contacts see it
// through the normal and the arm alone. A free body's coordinates begin at a multiple of eight.
//
// Of sparse trees, which are many small ones that rows couple, as the vertices of a flex, inv(H)
// would be large. What acts on them is solved for instead. Their factor is that of H where only
// degrees of freedom of one path are coupled. Where springs couple others it is that of M, which is
// not greater than H. So the apparent inverse masses of rows and all that bounds them are those of
// each body alone, on the safe side, while responses and statics are those of H.
//
// The first coordinates belong to the ground, which what is applied to it does not move: eight for
// each of four lanes (jacobian_lanes.hpp), so that no lane waits for what another applies. Two of
// them, that no body has, move by themselves: kSurfaceCoordinate at 1, so that its column in a
// row is the rate that surfaces of their own motion (conveyor belts) add, and kTurningCoordinate
// with acceleration 1, so that its column is what a row's rate gains because its Jacobian turns,
// dJ/dt xi. The others stay zero.

#pragma once

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <vector>

#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/sparse_inertia.hpp"

namespace dashpot {

// Numbers beyond what MuJoCo itself calls diverged, or NaN, named by the tree or degree of freedom.
// Data are as they were before the step.
struct DivergenceError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

inline constexpr int kBodyCoordinates = 8;  // of a free body
inline constexpr int kGroundCoordinates = 4 * kBodyCoordinates;
inline constexpr int kSurfaceCoordinate = 3;  // of the ground, moves at 1
inline constexpr int kTurningCoordinate = 7;  // of the ground, its velocity is time, s

struct Tree {
  int dof_begin = 0;  // range of generalized velocities
  int dof_count = 0;
  int begin = 0;               // range of motion coordinates
  int count = 0;               // a multiple of four
  bool sparse = false;         // inv(H) is not filled in (below)
  bool diagonal = false;       // and its factor couples nothing, as of vertices that slide
  bool free_body = false;      // in the coordinates of a free body, of which there are six in eight
  int inverse = 0;             // offset in Trees::inverse
  bool damped = false;         // its dampers act in the micro-steps (microstep.hpp)
  bool cross_damped = false;   // and D is more than a diagonal
  bool whole = false;          // Trees::whole_acceleration has its smooth acceleration
  bool sprung = false;         // its springs act in the micro-steps, too
  bool elastic = false;        // and all of both are those of Trees::implicit
  double implicit_time = 0.0;  // s, of a damped tree
};

// The motion coordinate of degree of freedom i of a tree.
inline int coordinate_of(const Tree& tree, int i) {
  return tree.begin + (tree.free_body && i >= 3 ? i + 1 : i);
}

// An entry of what an integrator treats implicitly beside M, and its mirror image: stiffness K, N/m
// or N m/rad, and damping D between two degrees of freedom, in numbers of all, row >= column.
struct ImplicitEntry {
  int row, column;
  double stiffness, damping;
};

struct Trees {
  std::vector<Tree> tree;
  int coordinates = kGroundCoordinates;
  // By tree. Free body: (1/m, 1/m, 1/m, 0) and the columns of the world inverse rotational inertia,
  // each with a zero. Any other tree: the columns of inv(H), `count` apart.
  AlignedDoubles inverse;
  // By tree that is no free body, at the offset of its inverse: the factor of factor_inertia. Its
  // rows begin at row_begin, by degree of freedom; columns count from the first of the tree.
  AlignedDoubles factor;
  std::vector<int> row_begin;
  // By tree: of sparse ones H whose springs couple what has no path; null where none do.
  std::vector<std::shared_ptr<SparseInertia>> sparse;
  std::vector<char> sparse_is_known;  // it is that of this step
  // By motion coordinate of these: 1 / sqrt(D).
  AlignedDoubles inverse_root;
  // D of damped trees: by motion coordinate its diagonal and, at the offset of the inverse of those
  // that are cross-damped, the columns of what is beside it. H has Tree::implicit_time times D.
  AlignedDoubles damping, cross_damping;
  // By motion coordinate of trees that are no free bodies: stiffness of the joint's spring (N/m,
  // N m/rad), which acts in the micro-steps of sprung trees.
  AlignedDoubles stiffness;
  // By motion coordinate, one after another: the smooth acceleration of trees by all derivatives.
  AlignedDoubles whole_acceleration;
  // By degree of freedom: joint dampers in D at the step's start, where not from derivatives.
  std::vector<double> joint_damping;
  // Those of `discrete` (model/discrete.hpp), tree after tree, where those of a tree begin, and
  // the step (s) of which qacc_smooth is.
  std::vector<ImplicitEntry> implicit;
  std::vector<int> implicit_begin;
  double implicit_step = 0.0;
  // By degree of freedom, the one above it in its tree, or -1. H couples it to all above it and
  // below it, and to no others.
  std::vector<int> above;
  // By degree of freedom, the last one that it carries, or itself: those below it lie between. And
  // where those above it begin in `path`, the nearest first; they end where the next one's begin.
  // Both in numbers from the first of their tree.
  std::vector<int> last_below, path_begin{0}, path;

  struct Entries {
    const ImplicitEntry *first, *last;
    const ImplicitEntry* begin() const { return first; }
    const ImplicitEntry* end() const { return last; }
    bool empty() const { return first == last; }
  };
  Entries implicit_of(int index) const {
    if (implicit.empty()) return {nullptr, nullptr};
    return {implicit.data() + implicit_begin[index], implicit.data() + implicit_begin[index + 1]};
  }

  // Whether it is sparse, and springs couple its bodies.
  bool is_soft(int index) const { return tree[index].sparse && !implicit_of(index).empty(); }
  bool has_implicit_springs(int index) const {
    const Entries of = implicit_of(index);
    return std::any_of(of.first, of.last, [](const auto& entry) { return entry.stiffness != 0.0; });
  }

  size_t end_of_factor(int index) const {
    return index + 1 < static_cast<int>(tree.size()) ? tree[index + 1].inverse : factor.size();
  }

  // Appends a tree with room for its inverse inertia, of either form. `above`: of its degrees of
  // freedom, in the numbers of all.
  void append(int dof_begin, int dof_count, bool free_body, const int* above,
              bool is_sparse = false);
};

// out += (damping D + stiffness K) x, over the coordinates of a tree: of Trees::implicit.
inline void add_implicit(const ImplicitEntry* first, const ImplicitEntry* last, int dof_begin,
                         double damping, double stiffness, const double* x, double* out) {
  for (; first != last; ++first) {
    const double entry = damping * first->damping + stiffness * first->stiffness;
    const int i = first->row - dof_begin, j = first->column - dof_begin;
    out[i] += entry * x[j];
    if (i != j) out[j] += entry * x[i];
  }
}
inline void add_implicit(const Trees& trees, int tree, double damping, double stiffness,
                         const double* x, double* out) {
  const Trees::Entries of = trees.implicit_of(tree);
  add_implicit(of.first, of.last, trees.tree[tree].dof_begin, damping, stiffness, x, out);
}

// acceleration += inv(H) force, over the coordinates of one tree.
void add_response(const Trees& trees, int tree, const double* force, double* acceleration);
// The same by the factor, where inv(H) is not filled in; of sparse trees it has to be asked for.
void add_solution(const Trees& trees, int tree, const double* force, double* acceleration);

// Throws DivergenceError that names the tree unless all its coordinates of `motion` are numbers
// of at most `largest`.
void check_bounded(const Tree& tree, const double* motion, double largest);

// x = inv(H) x, over the degrees of freedom of a tree that is no free body.
void solve_effective(const Trees& trees, int tree, double* x);
// Entry of the diagonal of inv(H) of degree of freedom i of such a tree, or more (sparse trees).
double inverse_diagonal(const Trees& trees, int tree, int i);

// H = L' D L of a tree that is not a free body, L of unit diagonal and as sparse as H below it:
// no entry fills in where rows are eliminated from the last one up (Featherstone, Rigid Body
// Dynamics Algorithms, 6.3). `inertia` is in rows that begin at Trees::row_begin, and keeps D on
// and L below its diagonal. False where H is not positive definite.
bool factor_inertia(const Trees& trees, int tree, double* inertia);
// Solution of H x = f; x is f before.
void solve_inertia(const Trees& trees, int tree, const double* factor, double* x);
// x' H x.
double inertia_form(const Trees& trees, int tree, const double* factor, const double* x);
// Fills in inv(H) and 1 / sqrt(D) of a tree that is not a free body.
void invert_inertia(Trees& trees, int tree, const double* factor);

}  // namespace dashpot
