// Memory carried from step to step in mjData's user data: the compression and the elastic
// displacement of every compressed contact, the deformation of every limit, equality and
// dry-friction row, the motion of mocap bodies, and the energy ledger. And a view of one step that
// has it. recall.hpp has what rows take from it.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// What one compressed contact remembers. Vectors are in the frame of geom 1.
struct RememberedContact {
  double geom[2];
  double source;                  // index among the detected contacts of the step that wrote it, or
                                  // -1 where it sleeps
  double sticking;                // 1 if friction stuck in the last micro-step
  double position[2][3];          // in the frames of geom 1 and geom 2, m
  double compression, stiffness;  // m, N/m
  double preload;                 // part of the compression beyond the overlap, m
  double slide[3], slide_stiffness;
  double spin, spin_stiffness;
  double roll[3], roll_stiffness;
  double energy_tank;  // energy that rising stiffness took from these springs, J
  double hit;          // RowData::hit, or Hit::kNow if it came to touch in that step as a hit;
                       // Hit::kNone where its island had contacts of other trees than its two
  double turning;      // of its normal, m/s^2, see RowGroup::turning
  SolrefLoad solref;

  bool was_hit() const { return hit != static_cast<double>(Hit::kNone); }
  bool was_hit_now() const { return hit == static_cast<double>(Hit::kNow); }
};

// What a limit, equality or dry-friction row remembers; zeros: nothing.
struct RememberedConstraint {
  double deformation, stiffness;    // m and N/m, or rad and N m/rad
  double preload;                   // part of the deformation beyond the position, m or rad
  double energy_tank;               // energy that rising stiffness took from its spring, J
  double beyond;                    // RowData::beyond, J
  double mean_force, turning_work;  // of an equality, see Memory::equality()
};

// Geoms, flexes and scalar constraints (by ConstraintInput::memory) of what sleeps, whose rows are
// not made and keep what they remember, or of what was moved by hand. All empty: there is nothing.
enum class GeomMark : char { kOther, kMarked, kOfNoTree };
struct MarkedRows {
  std::vector<GeomMark> geom;
  std::vector<char> flex;  // all of it is marked
  std::vector<char> constraint;
  // Of a contact that sleeps: one of its geoms does, the other one is of no tree that is awake.
  bool has_all(const std::array<int, 2>& geoms) const;
  bool has_any(const std::array<int, 2>& geoms) const;
};

// What memory has of a contact: the remembered point of its pair that it goes on from
// (islands/contact_matching.hpp), where it overlaps, or goes on as a hit, else -1; and the force
// (N) that all points of its pair bore at the end of the last step.
struct Match {
  int nearest = -1;
  bool parted = false;  // was hit, and has a gap now, see Memory::parted_hit
  double load = 0.0;
};

// What trees remember of the last step, see trapezoid.hpp. Views of storage; null in models of free
// bodies alone, and in those that can have no rows.
struct HeldMotion {
  double* length = nullptr;         // by tree: of the step, s; 0 where there is nothing to remember
  double* held = nullptr;           // by tree: 1 where rows that have a position moved it, else 0
  double* implicit_time = nullptr;  // by tree: Tree::implicit_time, s
  double* gravity_ahead = nullptr;  // by tree: 1 where it had the gravity of the middle, else 0
  double* energy = nullptr;         // by tree, J
  double* displacement = nullptr;   // over the step, by degree of freedom
  double* potential = nullptr;      // p, by degree of freedom
  double* drive = nullptr;          // e, by degree of freedom
  // Change of e since the step before without that of servos because joints move, by the same.
  double* commanded_change = nullptr;
  double* followed = nullptr;      // and of all such changes, what was followed
  double* acceleration = nullptr;  // a, by motion coordinate
  double* other_force = nullptr;   // g, by motion coordinate
};

// The mean velocity (m/s or rad/s) of a mocap body over a step; c, by which it had changed since
// the step before (m/s^2 or rad/s^2); and by how much c was not that of the step before.
struct MeanRate {
  std::array<double, 3> velocity, change, growth;
};

// What is remembered of a body that users move, see mocap_motion.hpp. Zeros: nothing yet.
struct RememberedMocap {
  std::array<double, 7> command, pose;      // position (m) and quaternion
  std::array<double, 3> velocity, angular;  // of the follower, m/s and rad/s, world
  double told_at;                           // when it was told where to be, s
  double rhythm, speed;                     // how long it had been before, and how fast that was
  double left;                              // until it is there, s; 0: it is, or follows
  double length;                            // of the last step, s
  MeanRate mean, mean_angular;              // over that step
};

// Room that memory takes: positions, contacts that can be compressed at once, scalar constraints,
// motion that rows may hold, and mocap bodies; and how many geoms and flexes may have contacts.
struct MemoryLayout {
  int positions = 0;  // nq
  int contacts = 0;
  int geoms = 0, flexes = 0;
  int constraints = 0;
  int held_trees = 0, held_dofs = 0, held_coordinates = 0;
  int driven_bodies = 0;
  int size() const;  // doubles
  int held_size() const;
  int mocap_size() const;
};

class Memory {
 public:
  // A view of `storage`, layout.size() doubles; zeroed storage is an empty memory.
  Memory(double* storage, const MemoryLayout& layout);

  // Throws std::invalid_argument where the storage, which users may write to, holds no count of
  // contacts that it has room for, or contacts of geoms that are none of the model's.
  void check() const;

  bool starts() const;    // no step was taken yet
  bool has_rows() const;  // it had a contact that was compressed, or a constraint
  // At the end of the last step, as in mjData.qpos. What differs was moved by hand.
  double* position() const;
  int contact_count() const;
  RememberedContact contact(int index) const;
  // Of that contact alone: its geoms, place in the frame of one (m), and the force (N) it bore.
  std::array<int, 2> geoms(int index) const;
  const double* position(int index, int side) const;
  double force(int index) const;
  // Gap (m) up to which it keeps its compression though geometry parts it: its own compression if
  // it was hit, for then rows frozen over a step lead too deep; else 0.
  double parted_hit(int index) const;
  EnergyLedger ledger() const;
  void set_ledger(const EnergyLedger& ledger);
  HeldMotion held_motion() const;
  // Velocities at the end of the last step, by degree of freedom, which tell whether trees go on
  // from there. Null where held_motion() is.
  double* end_velocity() const;
  RememberedMocap mocap(int index) const;
  void set_mocap(int index, const RememberedMocap& mocap);
  // Mean force of an equality over the last step (N, N m), and the work that it did because its row
  // turned (J); by ConstraintInput::memory.
  double* equality(int constraint) const;
  RememberedConstraint constraint(int index) const;  // by ConstraintInput::memory

  // Forgets how a tree moved (`index`): it is at rest.
  void rest(const Tree& tree, int index);
  // Forgets what rows of these store, but not that constraints had a stiffness: these are not new.
  void forget(const MarkedRows& moved);
  // How many contacts sleep, and the energy (J) in the springs of all rows that do.
  int count(const MarkedRows& sleeping) const;
  double energy(const MarkedRows& sleeping) const;

  // Replaces the memory by the rows of `data` of constraints and of the contacts that are
  // `compressed` (groups), but for what sleeps.
  void remember(const std::vector<ContactInput>& contacts,
                const std::vector<ConstraintInput>& constraints, const Rows& rows,
                const RowData& data, const std::vector<int>& compressed, const MarkedRows& sleeping,
                Team& team);

 private:
  void forget_constraints(const MarkedRows& sleeping);
  int gather(const MarkedRows& sleeping);
  void remember(const ConstraintInput& input, const Rows& rows, int group, const RowData& data);
  void remember(const ContactInput& input, const Rows& rows, int group, const RowData& data,
                int place);
  double* mocap_storage() const;
  double* constraint_storage() const;
  double* contact_storage(int index) const { return contacts_ + kContactSize * index; }

  // In doubles.
  static constexpr int kContactSize = sizeof(RememberedContact) / sizeof(double);
  static constexpr int kConstraintSize = sizeof(RememberedConstraint) / sizeof(double);

  double* storage_;
  MemoryLayout layout_;
  double* contacts_;  // where contacts are stored
};

// What is left of a step, or how far an impact is ahead, counts as nothing below this share of it.
constexpr double kSliverOfStep = 1e-9;

struct StepClock {
  double whole = 0.0;          // s, of the step
  double length = 0.0;         // H, s, of the substep, which is the whole step if nothing cuts it
  double row_turn_rate = 0.0;  // rad/s, of equalities in the substep before; 0 in the first
  bool cut_short = false;      // the substep ends at an impact
  int cuts = 0;                // at impacts, in the substeps before
};

struct StepView {
  double length;  // s
  const std::vector<ContactInput>& contacts;
  const std::vector<ConstraintInput>& constraints;
  Memory memory;                      // a view of what the last step left
  const std::vector<Match>& matches;  // per group: what it has of contacts
};

}  // namespace dashpot
