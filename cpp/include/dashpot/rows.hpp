// Contact rows of one step as packed arrays, in whitened coordinates.
//
// Each kinematic tree has a symmetric positive definite effective inertia H = L L' over its degrees
// of freedom (inertia plus what the integrator treats implicitly). In whitened coordinates
// y = L' v a row J of the contact Jacobian becomes Jw = J inv(L)', and
//
//     u = J v = Jw y,        J inv(H) J' = Jw Jw',        w = |Jw|^2 ,
//
// so the micro-steps apply impulses and read gap rates with dot products alone. A contact has
// `dim` rows in MuJoCo's order: normal, two sliding, torsional, two rolling. The normal points from
// geom 1 to geom 2, and row velocities are those of geom 2 relative to geom 1.

#pragma once

#include <array>
#include <vector>

namespace dashpot {

inline constexpr int kMaxRows = 6;

// A kinematic tree: a range of generalized velocities and their effective inertia.
struct Tree {
  int dof_begin = 0;
  int dof_count = 0;
  int factor = 0;       // offset of the row-major lower factor L in Trees::factor
  bool active = false;  // has rows in this step
};

struct Trees {
  std::vector<Tree> tree;
  std::vector<double> factor;  // sum of dof_count^2
};

// One contact as detection reports it, with its material resolved.
struct ContactInput {
  int source = 0;                    // index in the list of detected contacts
  std::array<int, 2> geom{};         // ids
  std::array<int, 2> tree{-1, -1};   // trees of the two bodies, -1 for static ones
  int dim = 1;                       // rows: 1, 3, 4 or 6
  double gap = 0.0;                  // m
  std::array<double, 3> position{};  // m, world
  std::array<double, 9> frame{};     // rows: normal, tangent 1, tangent 2; world
  std::array<double, 5> friction{};  // limit coefficients per friction row
  // Position in the frames of the two geoms, and geom 1's rotation (row-major, local to world).
  std::array<std::array<double, 3>, 2> local_position{};
  std::array<double, 9> rotation{};
};

// Rows of the whole step. Per-row arrays are indexed by ContactRows::row + i, i < dim.
struct ContactRows {
  int input = 0;  // index in the list of ContactInput
  int row = 0;    // first row
  int dim = 1;
  int jacobian = 0;                // offset of the first row's blocks; rows are `stride` apart
  int stride = 0;                  // dof_count[0] + dof_count[1]
  std::array<int, 2> dof_begin{};  // of the two blocks; a missing block has dof_count 0
  std::array<int, 2> dof_count{};
  std::array<int, 2> tree{-1, -1};  // trees of the two blocks
};

struct Rows {
  std::vector<ContactRows> contact;
  std::vector<double> jacobian;      // whitened, packed
  std::vector<double> inverse_mass;  // w, diagonal of J inv(H) J'

  // Material per row: stiffness (N/m, N m/rad), damping (N s/m, N m s/rad), friction coefficient
  // (1 or m; unused for normals).
  std::vector<double> stiffness, damping, friction;

  void clear();
  // Appends a contact with room for its rows; the blocks are to be filled in.
  ContactRows& append(int input, int dim, const Trees& trees, std::array<int, 2> tree);
};

// Factors the effective inertia of one tree: `inertia` is row-major, dof_count x dof_count, lower
// triangle used. Throws std::runtime_error if it is not positive definite.
void factor_inertia(Trees& trees, int tree, const std::vector<double>& inertia);

// Replaces the rows of a contact's Jacobian by their whitened form and computes inverse masses.
void whiten(Rows& rows, const ContactRows& contact, const Trees& trees);

// y = L' v and v = inv(L)' y over one tree.
void whiten_velocity(const Trees& trees, int tree, const double* velocity, double* whitened);
void unwhiten_velocity(const Trees& trees, int tree, const double* whitened, double* velocity);
// L x: turns a whitened impulse J_w' p into the generalized impulse J' p.
void generalized_impulse(const Trees& trees, int tree, const double* whitened, double* impulse);
// inv(L) f: turns a generalized force into a whitened acceleration.
void whiten_force(const Trees& trees, int tree, const double* force, double* whitened);

}  // namespace dashpot
