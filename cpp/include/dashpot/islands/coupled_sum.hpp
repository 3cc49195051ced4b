// Upper bounds on the coupled stiffness or damping of rows, tree by tree.
//
// Of lambda_max(K^1/2 A K^1/2), A = J inv(H) J'. With K = diag(k), (a + b)^2 <= (1 + |b|/|a|) a^2 +
// (1 + |a|/|b|) b^2 splits a row between its two trees T, so
//
//     lambda_max(K^1/2 A K^1/2) <= max_T lambda_max(inv(H_T) S_T),
//     S_T = sum_r k_r (1 + sqrt(w_r^other / w_r^T)) J_r^T' J_r^T ,
//
// w_r^T being the part of w_r that tree T contributes. The eigenvalues of B = inv(H_T) S_T are real
// and not negative. For free bodies lambda_max(B) <= trace(B^8)^(1/8) (body_sum.hpp). Of other
// trees B is like a symmetric C, S_T in mass-weighted coordinates, where H_T = 1, and for any x > 0
//
//     lambda_max(C) <= rho(|C|) <= max_i (|C| x)_i / x_i
//
// (Horn and Johnson, Matrix Analysis, 8.1.18 and 8.1.26), with x from some rounds of x <- |C| x.
// This is nearer than trace(C^4)^(1/4), and cheaper: with the rows of all joints of a hand 1.1
// times lambda_max instead of 1.7.
// Of sparse trees, where S_T would be large, |C| is the sum of the sizes of the rows' own products.

#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "dashpot/islands/body_sum.hpp"
#include "dashpot/lanes/aligned.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// S_T of every tree, of those that are no free bodies the lower triangle, `count` columns each,
// mass-weighted; zero between steps. Keeps its arrays from step to step. Threads may add rows of
// different trees at once, and take their bounds with a room of their own.
class CoupledSum {
 public:
  // For the matrix of a bound, and vectors of its size.
  struct Room {
    void fit(const Trees& trees);
    AlignedDoubles matrix, row, product;
    std::vector<int> reached;  // coordinates of one tree, from its first
  };

  void reset(const Trees& trees);
  // Adds `dim` rows of a group from the row `first` on over one of its trees, `weight` for each.
  void add(const Rows& rows, const Trees& trees, const RowGroup& group, int side, int first,
           int dim, const double* weight);
  // The same of a group: its first row goes to one sum, unless dry friction, the others to another.
  static void add_contact(const Rows& rows, const Trees& trees, const RowGroup& group, int side,
                          const double* weight, CoupledSum& normal, CoupledSum& friction);
  bool empty(int tree) const { return empty_[tree]; }
  // The bound of one tree, whose sum is zero afterwards; 0 where nothing was added.
  double take_bound(const Trees& trees, int tree, Room& room);
  // The same, but what was added goes to another sum.
  double replace(const Trees& trees, int tree, CoupledSum& to, Room& room);

 private:
  // Rows over a sparse tree, and what they are weighted by.
  struct SparseRows {
    const double* y;  // mass-weighted, `stride` apart
    const int* column;
    int count, stride, dim;
    std::array<double, kMaxRows> weight;
  };

  double bound_of_sparse(const Trees& trees, int tree, Room& room);
  double bound_of_joints(const Trees& trees, const Tree& tree, Room& room);
  double bound_of_reached(const Trees& trees, const Tree& tree, Room& room);
  void add_joints(const Trees& trees, const Tree& tree, Room& room);
  double bound(const Trees& trees, int tree, Room& room);
  std::array<AlignedDoubles*, 3> joint_sums() { return {&joint_, &end_[0], &end_[1]}; }
  double of_joint(int coordinate) const {
    return joint_[coordinate] + std::max(end_[0][coordinate], end_[1][coordinate]);
  }
  void clear(const Trees& trees, int tree);

  std::vector<std::vector<SparseRows>> rows_;  // by tree; of sparse ones
  std::vector<BodySum> body_;                  // by tree; of free bodies
  AlignedDoubles entry_;                       // of others
  // By motion coordinate: the sum of the rows of this one coordinate, not mass-weighted. Ends of a
  // range are summed by sign, of which the larger counts: both ends are never pressed at once.
  AlignedDoubles joint_;
  std::array<AlignedDoubles, 2> end_;
  // By tree: nothing was added; rows of several coordinates were.
  std::vector<char> empty_, wide_;
  std::vector<char> reaches_;  // by motion coordinate: a sparse row has it
};

}  // namespace dashpot
