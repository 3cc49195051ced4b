// Contact and constraint rows of one step, over the motion coordinates of trees.hpp.
//
// For motion coordinates xi, Jacobian rows J and effective inertia H,
//
//     u = J xi,        A = J inv(H) J',        w = diag(A) .
//
// A contact is a group of `dim` rows in MuJoCo's order: normal, two sliding, torsional, two
// rolling. The normal points from geom 1 to geom 2, and row velocities are those of geom 2 relative
// to geom 1. A limit, an equality row or a dry-friction row is a group of one. Rows of a contact
// between free bodies, or one and the ground, are its frame and two arms; all others are sparse.

#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "dashpot/rows/trees.hpp"

namespace dashpot {

inline constexpr int kMaxRows = 6;
inline constexpr double kDirection = 1e-5;  // rad, to which collision knows a contact's frame
// Fraction of the typical inverse mass that counts as singular.
inline constexpr double kSingular = 0.01;

// Where in a step the geometry of a contact is frozen.
enum class Frozen {
  kAtStart,
  kAtImpact,  // where bodies that fly meet, see flight_contacts.hpp
  kAhead      // where the bodies are after `ahead`, see detect/turning.hpp
};

using GeomPair = std::array<int, 2>;  // ids; -1 - id for a flex

// One contact as detection reports it, with its material resolved.
struct ContactInput {
  int source = 0;  // index in the list of detected contacts
  GeomPair geom{};
  std::array<int, 2> tree{-1, -1};  // trees of the two bodies, -1 for static ones
  // Geoms whose contacts with geom 1 at an internal edge are ghosts of this one, else -1.
  std::array<int, 3> ghosts{-1, -1, -1};
  // Side of the geom whose surface another one continues (detect/internal_edges.hpp), else -1.
  int continued = -1;
  int dim = 1;                       // rows: 1, 3, 4 or 6
  double gap = 0.0;                  // m, distance less margin
  double margin = 0.0;               // m
  std::array<double, 3> position{};  // m, world
  std::array<double, 9> frame{};     // rows: normal, tangent 1, tangent 2; world
  // From the point of geom 1 on which the contact acts to that of geom 2, about `position`: where
  // they are apart, bodies go on until these meet. World, m.
  std::array<double, 3> apart{};
  Frozen frozen = Frozen::kAtStart;
  bool is_of_round_hit = false;  // of two round bodies alone, see detect/pair_hits.hpp
  // Of contacts frozen within the step: the time (s) that leads there, its middle but for hits, and
  // the acceleration (m/s^2) of the gap and of sliding because normal and arms turn.
  double ahead = 0.0;
  std::array<double, 3> turning{};
  // m/s^2, world: acceleration of the surface of geom 2 against that of geom 1 because mocap bodies
  // change their velocity within the step (model/mocap_motion.hpp).
  std::array<double, 3> surface_acceleration{};
  std::array<double, 5> friction{};  // limit coefficients per friction row
  std::array<double, 2> solref{};
  std::array<double, 5> solimp{};
  bool has_solref = false;  // the model sets solref or solimp itself
  // Position in the frames of the two geoms, and geom 1's rotation (row-major, local to world). A
  // flex has the frame of the geom on the other side, or the world's.
  std::array<std::array<double, 3>, 2> local_position{};
  std::array<double, 9> rotation{};

  bool is_at_internal_edge() const { return ghosts[0] >= 0; }
  bool is_of_pair(const GeomPair& of) const { return geom == of; }
  bool is_of_flex() const { return geom[0] < 0 || geom[1] < 0; }
  // Where it acts on the geom of a side. In the middle between two bodies apart friction would have
  // another arm than where they meet, and so would the two bodies' angular momenta.
  std::array<double, 3> acting_point(int side) const {
    std::array<double, 3> point = position;
    for (int i = 0; i < 3; ++i) point[i] += (side ? 0.5 : -0.5) * apart[i];
    return point;
  }
};

// A vector (world) along the normal and the tangents of a contact.
std::array<double, 3> along_frame(const ContactInput& contact, const std::array<double, 3>& vector);

// What law a group of rows obeys.
enum class RowKind {
  kContact,     // unilateral normal, friction rows limited by it
  kUnilateral,  // frictionless: joint and tendon limits
  kBilateral,   // spring-damper of either sign: equalities
  kSlider       // spring-damper in series with a slider of fixed limit: dry friction, dampers
};

// One scalar constraint as MuJoCo instantiates it.
struct ConstraintInput {
  RowKind kind = RowKind::kUnilateral;
  int source = 0;  // row in mjData.efc_*, below 0 of dampers (springs_and_dampers.hpp)
  int memory = 0;  // index of its memory, fixed by the model; -1 for none
  std::array<int, 2> tree{-1, -1};  // the second one is -1 where there is but one
  double position = 0.0;            // gap of a limit, error of an equality; m or rad
  double drive = 0.0;               // rate at which mocap bodies change the position, m/s or rad/s
  double limit = 0.0;               // of a slider, N or N m
  double damping = 0.0;             // of a damper, N s/m or N m s/rad
  std::array<double, 2> solref{};
  std::array<double, 5> solimp{};
  bool has_solref = false;   // the model sets solref or solimp itself
  bool is_of_mocap = false;  // an equality that a mocap body holds something by
  // Rows of an equality, from this on, with one impedance, by the norm of their positions; else 0.
  int together = 1;
  bool is_joint_limit = false;
  int ball = -1, tendon = -1;  // ball joint or tendon whose limit it is, else -1
  double side = 1.0;           // of a tendon's limit: +1 below it, -1 above
};

// The geometry of a contact between free bodies, which is all of its Jacobian.
struct PairGeometry {
  std::array<int, 2> begin{};                  // coordinates of the two bodies; 0 for the ground
  std::array<double, 9> frame{};               // rows: normal, tangent 1, tangent 2; world
  std::array<std::array<double, 3>, 2> arm{};  // from the centre of mass to the contact, world, m
};

// Rows over one tree that is no free body in coordinates in which its inertia H = L' D L is 1,
// y = J inv(D^1/2 L), so that A = y y'. They reach what J reaches and all that is above.
struct MassWeighted {
  int column = 0;  // first in Rows::weighted_column
  int count = 0;
  int value = 0;  // first in Rows::weighted_value; rows are padded(count) apart, with zeros behind
};

// At which load a model's own solref is read, m/s^2, 0 where there is none or it means the same
// under any, and for how long the contact has been still, s (solref_load.hpp).
struct SolrefLoad {
  double load = 0.0, still = 0.0;
};

// A group of rows. Per-row arrays of Rows are indexed by RowGroup::row + i, i < dim.
struct RowGroup {
  RowKind kind = RowKind::kContact;
  int input = 0;  // index in the list of ContactInput or ConstraintInput
  int row = 0;    // first row
  int dim = 1;
  std::array<int, 2> tree{-1, -1};  // a second one only where it differs from the first
  int pair = -1;                    // index in Rows::pair, or -1 for sparse rows
  // Sparse rows share their columns: those of tree[0], those of tree[1], and a coordinate of the
  // ground if a surface moves by itself or the row turns.
  int column = 0;                          // first in Rows::column
  std::array<int, 2> columns{};            // number in each tree
  int ground = -1;                         // kSurfaceCoordinate, kTurningCoordinate, or -1 for none
  int value = 0;                           // first in Rows::value; rows are `width()` apart
  std::array<MassWeighted, 2> weighted{};  // by side; of rows of several coordinates
  // N: many times the weight of what touches, for contacts of an SI stiffness; twice the load that
  // it is read at, for those on a model's own solref; 0 for others.
  double soft_load = 0.0;
  SolrefLoad solref;
  double stored = 0.0;  // J, by a limit or equality at its position, where its load is read there
  double loaded_friction = 1.0, friction_load = 1.0;  // s and F of friction.hpp
  // Of ContactInput, and of limits of spatial tendons and ball joints (model/row_turns.hpp). With
  // the turn of the geometry goes what the surfaces accelerate by along the rows.
  double ahead = 0.0;
  std::array<double, 3> turning{}, surface_acceleration{};
  bool is_of_round_hit = false;
  // Of the contacts between its two bodies: the mean w of their normals, 1/kg, 0 of what is no
  // contact; the first of these groups; and the square of the frequency at which they are pressed
  // together, over that of one of this w alone (modal_damping.hpp).
  double pair_inverse_mass = 0.0;
  int first_of_pair = 0;
  double pressed = 1.0;
  // Inverse mass of all that moves with its bodies, over that of its own normal (tied_mass.hpp).
  double tied = 1.0;

  // The limit of one end of a joint's range; the other is a group too, and one at most is pressed.
  bool is_end_of_range = false;
  bool is_damper = false;  // springs_and_dampers.hpp

  // False of a contact apart that no joint can close along the normal: it belongs to no island.
  bool can_be_loaded = true;

  // Pushes one way: a contact or a limit.
  bool is_unilateral() const { return kind == RowKind::kContact || kind == RowKind::kUnilateral; }
  // One row over one coordinate of a tree, as limits and dry friction of hinges and slides have.
  bool is_of_one_coordinate(int side) const { return pair < 0 && dim == 1 && columns[side] == 1; }
  int width() const { return columns[0] + columns[1] + (ground >= 0); }
};

struct Rows {
  std::vector<RowGroup> group;
  std::vector<int> equality;    // groups of RowKind::kBilateral
  std::vector<int> on_surface;  // groups with kSurfaceCoordinate
  std::vector<PairGeometry> pair;
  std::vector<int> column;           // motion coordinates
  std::vector<double> value;         // of sparse rows
  std::vector<int> weighted_column;  // motion coordinates, the lowest of a tree first
  AlignedDoubles weighted_value;

  // Per row: w, diagonal of J inv(H) J', and the parts of it that the two trees contribute.
  std::vector<double> inverse_mass;
  std::vector<std::array<double, 2>> tree_inverse_mass;
  // MuJoCo's estimate of w from the reference configuration: w away from singular ones.
  std::vector<double> typical_inverse_mass;

  // Per row: stiffness (N/m, N m/rad), damping (N s/m, N m s/rad), and limit: the friction
  // coefficient (1 or m) of a contact's friction row, the force (N, N m) of a slider.
  std::vector<double> stiffness, damping, friction;

  bool weighs_all = true;  // w is found of all rows, else of those alone that push both ways
  double metre = 1.0;      // in the model's unit of length
  int appended = 0;        // rows of the groups so far

  bool weighs(const RowGroup& c) const { return weighs_all || !c.is_unilateral(); }

  // w, but no less than a hundredth of the typical one. Near a singular configuration w falls by
  // orders of magnitude within a step; stiffness and energies per apparent mass go by this bound.
  double bounded_inverse_mass(int row) const {
    return std::max(inverse_mass[row], kSingular * typical_inverse_mass[row]);
  }

  // Empties everything and makes room for `count` rows, of groups to be appended.
  void reset(int count);
  // Appends a group; its pair geometry or sparse rows are to be appended next.
  RowGroup& append(RowKind kind, int input, int dim, std::array<int, 2> tree);
};

// out = J xi: the rates of a group's rows, or of the first `dim` of them.
void gather(const Rows& rows, const RowGroup& group, int dim, const double* motion, double* out);
inline void gather(const Rows& rows, const RowGroup& group, const double* motion, double* out) {
  gather(rows, group, group.dim, motion, out);
}
// That of the first row: a contact's normal.
inline double first_rate(const Rows& rows, const RowGroup& group, const AlignedDoubles& motion) {
  double rate;
  gather(rows, group, 1, motion.data(), &rate);
  return rate;
}
// force += J' impulse, of all rows or of the first `dim`.
void scatter(const Rows& rows, const RowGroup& group, int dim, const double* impulse,
             double* force);
inline void scatter(const Rows& rows, const RowGroup& group, const double* impulse, double* force) {
  scatter(rows, group, group.dim, impulse, force);
}

// What of RowGroup::turning is the turn of a contact's normal and arms, m/s^2.
inline double turn_of_normal(const RowGroup& group) {
  return group.turning[0] - group.surface_acceleration[0];
}

// Adds the column of a moving coordinate of the ground to the sparse rows of the group appended
// last: `rate` (dim) is what it adds to each row's rate where it moves at 1.
void append_ground_motion(Rows& rows, int coordinate, const double* rate);
// Rate at which a group of one row turns: what kTurningCoordinate adds to it; 0 without one.
double turning_rate(const Rows& rows, const RowGroup& group);
// Lets a row turn no more; groups without kTurningCoordinate stay.
void stop_turning(Rows& rows, const RowGroup& group);
// Work that the surfaces' own motion does on the bodies through `impulse` (dim), J.
double surface_work(const Rows& rows, const RowGroup& group, const double* impulse);

// Of rows i and i + 1 of a group, along two tangents, the one along which more moves: across the
// plane of a planar mechanism nothing does, and stiffness is a matter of rounding.
int more_mobile(const Rows& rows, const RowGroup& group, int i);

// Largest compression (m) of a contact or limit under which recovery of overlap goes on: one that
// stores the kinetic energy of the apparent mass at the recovery speed, k x^2 = v^2 / w, or carries
// the soft load. Recovery moves bodies, it does not squeeze what cannot move.
double bearable_compression(const Rows& rows, const RowGroup& group, double recovery_speed);

// At most how fast (m/s) a contact's overlap recovers along its normal. Of a link that turns about
// the normal, but for some tilt, next to nothing of the apparent mass moves along it: pushed out at
// the whole speed it turned at tens of rad/s. There its points move sideways at some three times
// the recovery speed, at most.
double recovery_speed_along(const Rows& rows, const RowGroup& group, double recovery_speed);

// Fills in the inverse masses of a group's rows, and the mass-weighted ones (mass_weighted.hpp).
void find_inverse_mass(Rows& rows, RowGroup& group, const Trees& trees);

// The entries of row i of a pair for one of its bodies: linear (3) and angular (3).
std::array<double, 6> pair_row(const PairGeometry& pair, int i, int side);

}  // namespace dashpot
