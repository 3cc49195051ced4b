// Contact and constraint rows of one step as packed arrays, in whitened coordinates.
//
// Each kinematic tree has a symmetric positive definite effective inertia H = L L' over its degrees
// of freedom (inertia plus what the integrator treats implicitly). In whitened coordinates
// y = L' v a row J of the contact Jacobian becomes Jw = J inv(L)', and
//
//     u = J v = Jw y,        J inv(H) J' = Jw Jw',        w = |Jw|^2 ,
//
// so the micro-steps apply impulses and read gap rates with dot products alone. A contact is a
// group of `dim` rows in MuJoCo's order: normal, two sliding, torsional, two rolling. The normal
// points from geom 1 to geom 2, and row velocities are those of geom 2 relative to geom 1. A limit,
// an equality row or a dry-friction row is a group of one.

#pragma once

#include <array>
#include <vector>

namespace dashpot {

inline constexpr int kMaxRows = 6;

// A kinematic tree: a range of generalized velocities and their effective inertia.
struct Tree {
  int dof_begin = 0;
  int dof_count = 0;
  int factor = 0;  // offset of the row-major lower factor L in Trees::factor
};

struct Trees {
  std::vector<Tree> tree;
  std::vector<double> factor;  // sum of dof_count^2
};

// One contact as detection reports it, with its material resolved.
struct ContactInput {
  int source = 0;                    // index in the list of detected contacts
  std::array<int, 2> geom{};         // ids; -1 - id for a flex
  std::array<int, 2> tree{-1, -1};   // trees of the two bodies, -1 for static ones
  int dim = 1;                       // rows: 1, 3, 4 or 6
  double gap = 0.0;                  // m
  std::array<double, 3> position{};  // m, world
  std::array<double, 9> frame{};     // rows: normal, tangent 1, tangent 2; world
  std::array<double, 5> friction{};  // limit coefficients per friction row
  std::array<double, 2> solref{};
  std::array<double, 5> solimp{};
  bool has_solref = false;  // the model sets solref or solimp itself
  // Position in the frames of the two geoms, and geom 1's rotation (row-major, local to world). A
  // flex has the frame of the geom on the other side, or the world's.
  std::array<std::array<double, 3>, 2> local_position{};
  std::array<double, 9> rotation{};
};

// What law a group of rows obeys.
enum class RowKind {
  kContact,     // unilateral normal, friction rows limited by it
  kUnilateral,  // frictionless: joint and tendon limits
  kBilateral,   // spring-damper of either sign: equalities
  kSlider       // spring-damper in series with a slider of fixed limit: dry friction loss
};

// One scalar constraint as MuJoCo instantiates it.
struct ConstraintInput {
  RowKind kind = RowKind::kUnilateral;
  int source = 0;  // row in mjData.efc_*
  int memory = 0;  // index of its memory, fixed by the model
  std::array<int, 2> tree{-1, -1};
  double position = 0.0;  // gap of a limit, error of an equality; m or rad
  double limit = 0.0;     // of a slider, N or N m
  std::array<double, 2> solref{};
  std::array<double, 5> solimp{};
  bool has_solref = false;  // the model sets solref or solimp itself
};

// A group of rows. Per-row arrays of Rows are indexed by RowGroup::row + i, i < dim.
struct RowGroup {
  RowKind kind = RowKind::kContact;
  int input = 0;  // index in the list of ContactInput or ConstraintInput
  int row = 0;    // first row
  int dim = 1;
  int jacobian = 0;                // offset of the first row's blocks; rows are `stride` apart
  int stride = 0;                  // dof_count[0] + dof_count[1]
  std::array<int, 2> dof_begin{};  // of the two blocks; a missing block has dof_count 0
  std::array<int, 2> dof_count{};
  std::array<int, 2> tree{-1, -1};  // trees of the two blocks
};

struct Rows {
  std::vector<RowGroup> group;
  std::vector<double> jacobian;      // whitened, packed
  std::vector<double> inverse_mass;  // w, diagonal of J inv(H) J'
  // MuJoCo's estimate of w from the reference configuration: what w is like away from singular
  // ones.
  std::vector<double> typical_inverse_mass;

  // Per row: stiffness (N/m, N m/rad), damping (N s/m, N m s/rad), and limit: the friction
  // coefficient (1 or m) of a contact's friction row, the force (N, N m) of a slider.
  std::vector<double> stiffness, damping, friction;

  // w, but no less than a hundredth of the typical one. Near a singular configuration w falls by
  // orders of magnitude within a step; stiffness and energies per apparent mass go by this bound.
  double bounded_inverse_mass(int row) const;

  void clear();
  // Appends a group with room for its rows; the blocks are to be filled in.
  RowGroup& append(RowKind kind, int input, int dim, const Trees& trees, std::array<int, 2> tree);
};

// Factors the effective inertia of one tree: `inertia` is row-major, dof_count x dof_count, lower
// triangle used. Throws std::runtime_error if it is not positive definite.
void factor_inertia(Trees& trees, int tree, const std::vector<double>& inertia);

// Replaces the rows of a group's Jacobian by their whitened form and computes inverse masses.
void whiten(Rows& rows, const RowGroup& group, const Trees& trees);

// y = L' v and v = inv(L)' y over one tree.
void whiten_velocity(const Trees& trees, int tree, const double* velocity, double* whitened);
void unwhiten_velocity(const Trees& trees, int tree, const double* whitened, double* velocity);
// L x: turns a whitened impulse J_w' p into the generalized impulse J' p.
void generalized_impulse(const Trees& trees, int tree, const double* whitened, double* impulse);
// inv(L) f: turns a generalized force into a whitened acceleration.
void whiten_force(const Trees& trees, int tree, const double* force, double* whitened);

}  // namespace dashpot
