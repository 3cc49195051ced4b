// How every tree moves over a step: its smooth motion in motion coordinates, which the rows start
// from, and its state at the end of the step, with what the rows added.
//
// Free bodies follow the accurate motion of free_body.hpp. All other trees, the linked ones, take
// the integral of their micro-step velocities, and with the Verlet corrector of each step
// (trapezoid.hpp) follow velocity Verlet, in flight as under rows. MuJoCo's integrator has those of
// models that can have no rows, and all of the complementarity-free law.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/elastic_forces.hpp"
#include "dashpot/rows/free_body.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/trees.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// What rows did to a tree in a step.
struct RowsOnTree {
  bool touched = false;  // moved it
  bool joined = false;   // as they moved another tree against it
  // In the geometry of a time within the substep, its middle or that of a hit.
  bool frozen_ahead = false;
  bool trapezoidal = false;  // its motion follows the trapezoidal rule (trapezoid.hpp)
  double unpaid = 0.0;       // J, work of contacts, because they turn, that no spring paid for
};

class TreeMotion {
 public:
  // Unless `own`, all trees move as MuJoCo moves them.
  TreeMotion(const mjModel_* model, bool own);
  bool own() const { return own_; }

  // Whether it is a free body that moves as one, not as MuJoCo moves it.
  bool is_accurate(int tree) const;
  // By tree: it is another one that moves as in the micro-steps.
  const std::vector<char>& linked() const { return linked_; }
  // Whether MuJoCo's integrator moves any tree.
  bool any_by_mujoco() const { return any_by_mujoco_; }
  // Whether it sleeps, and does not move.
  bool sleeps(int tree) const { return sleeps_[tree]; }
  // Whether springs or servos act on such a body.
  bool is_sprung(int tree) const;

  // Reads the state at the start of a step, and finds who moves which tree: in models that may have
  // rows no tree is MuJoCo's.
  void start(const mjData_* d, bool may_have_rows);
  // The smooth motion over `length` (s), implicit in velocity as the integrator is; fills in the
  // velocity and smooth acceleration of `data`. `rough`: for the search of impacts alone. Throws
  // DivergenceError where it has diverged.
  void find_smooth_motion(mjData_* d, double length, bool rough, RowData& data, Team& team);
  // Finds the smooth motion as it looks from the geometry of the middle, which `d` holds.
  void freeze_at_middle(mjData_* d, double length, RowData& data, Team& team);
  // Freezes one free body where its velocity takes it in `time` (s).
  void freeze_ahead(int tree, double time);
  // Whether it is a free body in the coordinates of one, and moves accurately.
  bool can_freeze_ahead(int tree) const { return trees_.tree[tree].free_body && is_accurate(tree); }
  // What translations have of a tree's acceleration by Coriolis and centrifugal forces, over its
  // velocity, both at the start and in the norm of the inertia, 1/s. Not of free bodies.
  double translation_by_turning(const mjData_* d, int tree);
  // Lets the dampers of a tree act in its micro-steps; to be called before inv(H) is asked for.
  void damp_in_microsteps(const mjData_* d, int tree, bool is_held);
  // Lets the springs of its joints act there (model/springs_and_dampers.hpp).
  void spring_in_microsteps(int tree);
  // Fills in inv(H) of a tree, or of all that were asked for: until then that of another step.
  void invert_inertia(const mjData_* d, int tree);
  void ask_for_inverse(const std::array<int, 2>& trees);
  void invert_inertia(const mjData_* d, Team& team);

  // Generalized velocities or displacements, and forces, from motion coordinates of one tree.
  void to_generalized(int tree, const double* coordinates, double* generalized) const;
  void to_generalized_force(int tree, const double* coordinates, double* force) const;

  // Adds `change`, by motion coordinate of all, to the velocity of a tree.
  void add_velocity(mjData_* d, int tree, const double* change);
  // Writes the end of the step to `d`, where MuJoCo's integrator has already advanced everything.
  // Returns the energy (J) that rows gave the tree and that it does not have then, negative where
  // it has more; of trees on the trapezoidal rule, which has the rest, what no spring had paid for.
  // Threads may advance accurate trees at once.
  double advance(mjData_* d, int tree, double length, const RowsOnTree& by_rows, RowData& data);

  // What generalized forces of servos on free bodies change by up to the middle of the step, where
  // they act; empty without.
  const std::vector<double>& servo_change() const { return elastic_forces_.servo_change(); }

  const Trees& trees() const { return trees_; }
  int tree_count() const { return static_cast<int>(trees_.tree.size()); }
  const std::vector<double>& start_velocity() const { return start_velocity_; }            // (nv)
  const std::vector<double>& smooth_acceleration() const { return smooth_acceleration_; }  // (nv)

 private:
  void fill_inverse(const mjData_* d, int tree);
  void find_sleeping(const mjData_* d);
  void stay(int tree, RowData& data);
  void load_from_springs(const mjData_* d, double length, RowData& data);
  void to_coordinates(int tree, const double* generalized, double* coordinates) const;
  double contact_work(int tree, double length, const RowData& data) const;
  double advance_free_body(mjData_* d, int tree, double length, const RowsOnTree& by_rows,
                           const RowData& data);

  const mjModel_* model_;
  bool own_, moves_links_ = false, any_by_mujoco_ = false;
  std::vector<char> linked_;
  Trees trees_;
  std::vector<host::WeldedParts> parts_;                 // by tree, if any has some
  std::vector<double> start_position_, start_velocity_;  // generalized
  std::vector<double> smooth_acceleration_;              // generalized
  std::vector<FreeMotion> free_motion_;                  // by tree; meaningful for free bodies
  host::ElasticForces elastic_forces_;
  std::vector<char> sleeps_;                         // by tree
  std::vector<char> inverted_;                       // by tree: its inverse inertia is filled in
  std::vector<int> to_invert_;                       // trees
  std::vector<double> displacement_, end_velocity_;  // generalized, of one tree
};

}  // namespace dashpot
