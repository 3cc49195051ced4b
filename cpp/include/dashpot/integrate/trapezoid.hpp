// The Verlet corrector of the trapezoidal rule, of linked trees and of what equalities couple.
//
// Micro-steps see the smooth forces of the start of a step, and equalities its geometry. A motion
// integrated so gains energy, in parts about omega^2 H / 2 a second. Velocity Verlet (RATTLE:
// Andersen, J. Comput. Phys. 52, 1983) takes the mean of the accelerations at both ends of the step
// instead. That at the end is known when the next step has its rows:
//
//     v  +=  s H / 2 (a' - a),    a  = inv(H0) (f0 + g + J0' lambda),
//                                 a' = inv(H1) (f1 + g + J1' lambda),
//
// f: smooth forces of position and velocity alone, bias and springs; g: all others, of limits and
// contacts too, which have the geometry of the middle (detect/turning.hpp); lambda: mean forces of
// the equality rows; H: length of the step; H0 and H1: effective inertia.
//
// Forces of actuators, and those that users apply, most often follow from the motion too. So a' has
// their change e' - e, unless no s near 1 is left with it, or they jump (drive_changes.hpp).
//
// Linear springs of slides and hinges act along in the micro-steps (microstep.hpp): g has their
// mean force, and p has none of its change. So do all springs of soft trees (trees.hpp), whose
// bodies feel nothing else that changes: contacts leave them no Verlet corrector.
//
// Of the Verlet corrector, rows that hold the tree against the ground leave what holding_rows.hpp
// says: they bear the rest, as a foot on the floor what the spring of its leg gains. They do so in
// the step in which the corrector is added, of whose forces it is a part.
//
// The corrector of gravity comes a step late. Where gravity turns light parts far meanwhile,
//
//     H^2 m g l / 2 I > 1,    l: from a joint to the centre of mass m of all that hangs on it,
//
// as the links of a rope on the floor about their own axes, that feeds on itself. There gravity is
// that of the middle of the step, as contacts are (model/velocities.hpp): a load beside the smooth
// forces in this step, and no part of the Verlet corrector, which then has springs alone for p.
//
// The smooth motion of a free body is exact, and rows change its momentum: there, a' - a is inv(H1)
// (J1 - J0)' lambda, and contacts leave no Verlet corrector.
//
// s is 1 of trees that no row with a position held in the step, and where springs, weights and
// servos bring a' - a; elsewhere 1 to first order in H, and such that energy is conserved
// (coupled_energy.hpp); trees that equalities couple share it (coupled_energy.hpp). Where none is
// found, or equalities would turn too far even in a substep (turning_substeps.hpp), frozen
// geometry stays: the Verlet corrector is left out, they do not turn in that step, and the work of
// those that did is booked as dissipation.

#pragma once

#include <vector>

#include "dashpot/integrate/coupled_energy.hpp"
#include "dashpot/integrate/drive_changes.hpp"
#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/rows/holding_rows.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// How a step ended.
struct EndOfStep {
  double length;  // s
  // False: the step had the geometry of its middle, or another law, and leaves nothing over.
  bool leaves_corrector;
  const std::vector<ConstraintInput>& constraints;
  const Rows& rows;
  const RowData& data;
  const std::vector<char>& held;            // by tree: rows that have a position moved it
  const std::vector<double>& displacement;  // nv; what the change of kinetic energy went with
};

// The rule for all trees of a model; keeps its arrays from step to step.
class Trapezoid {
 public:
  explicit Trapezoid(const mjModel_* model) : model_(model) {}

  // After the rows of a step are known: adds to the velocities in `data` what the last step left
  // over, where a tree goes on with the velocity that step gave it. Trees that equalities couple
  // share s. Takes the turning from `rows` of equalities where they may not turn in this step.
  // `whole`: with s = 1 whatever energies say, as derivatives need it: of vanishing motion about
  // rest they determine none.
  void finish_last_step(const mjData_* d, const StepView& step, bool whole, TreeMotion& motion,
                        Rows& rows, RowData& data, EnergyLedger& ledger);

  // At the end of the step, after Memory::remember: keeps what its Verlet corrector needs.
  void keep(const mjData_* d, const EndOfStep& end, const TreeMotion& motion, Memory& memory,
            EnergyLedger& ledger);

  // Of this step: whether a tree has a Verlet corrector, and what was added to velocities, by
  // motion coordinate; null where nothing was.
  bool holds(int tree) const { return !first_.empty() && first_[tree] >= 0; }
  bool is_coupled_by_equalities(int tree) const {
    return holds(tree) && coupled_[first_[tree]].by_equalities;
  }
  const double* added_velocity() const { return added_.empty() ? nullptr : added_.data(); }
  // Adds to `impulse`, by row, what rows bore of that.
  void add_borne(std::vector<double>& impulse);
  // rad, most that a row of an equality turns in this step (turning_substeps.hpp).
  double fastest_turn() const { return fastest_turn_; }

 private:
  // The steps of finish_last_step(), in its order.

  // Finds which trees that contacts may hold have light parts.
  void find_light_trees(const mjData_* d, const StepView& step, TreeMotion& motion);
  // Finds which trees have a Verlet corrector, and which of them share s.
  void couple_trees(const Rows& rows, const TreeMotion& motion);
  void find_left_correctors(const Memory& memory, const TreeMotion& motion);
  void find_potential_forces(const mjData_* d, const TreeMotion& motion);
  // Adds up what the equalities of the last step did: J1' lambda, and their work by turning.
  void recall_equalities(const StepView& step, const Rows& rows, const Trees& trees);
  // Finds Verlet correctors and their s, without drives where these leave none; false without any.
  bool find_scales(const mjData_* d, double length, bool whole, const Memory& memory,
                   TreeMotion& motion);
  void find_corrector(const mjData_* d, const Memory& memory, TreeMotion& motion);
  static bool differs_in_damping(const Trees& trees, int tree, const HeldMotion& before);
  void respond(const mjData_* d, const Trees& trees, int tree, const HeldMotion& before,
               const double* force, double* response) const;
  double work_of_drives(const mjData_* d, const Trees& trees, int tree, const HeldMotion& before,
                        const std::vector<double>& velocity);
  // What of p the Verlet corrector of a tree's step has: of one with gravity ahead, springs alone.
  double changing_potential(const mjData_* d, bool gravity_ahead, int dof) const;
  void find_energies(const mjData_* d, double length, const Memory& memory,
                     const TreeMotion& motion);
  // Finds what of it is in translations that coupled trees have in common.
  void find_common_momenta(const mjData_* d, const TreeMotion& motion);
  // Finds what tells whether springs and drives alone bring the Verlet corrector.
  void find_springs(const mjData_* d, const Memory& memory, const TreeMotion& motion);
  // Corrects the speed of trees without s, where coupled_energy.hpp lets it; no equalities turn.
  void correct_speeds();
  void book_corrector(EnergyLedger& ledger) const;
  void add_corrector(const Trees& trees, RowData& data);
  void count_followed_changes(const Trees& trees);
  void stop_fast_turns(double length, Rows& rows);
  // Adds a tree's part of a load (nv) to its smooth acceleration.
  void add_load(const std::vector<double>& load, int tree, const Trees& trees, RowData& data);
  // Takes the gravity of light parts on trees that contacts may hold to where these are frozen.
  void load_gravity(const mjData_* d, const TreeMotion& motion, RowData& data);

  // The steps of keep().

  // Keeps the mean forces of equalities, also in `wrench_`, and the work that their turning did.
  void keep_equalities(const EndOfStep& end, Memory& memory, EnergyLedger& ledger);
  // Keeps the length of the step for trees that it leaves a Verlet corrector of; whether any are.
  bool keep_lengths(const EndOfStep& end, const TreeMotion& motion, HeldMotion& now) const;
  void keep_tree(const mjData_* d, const EndOfStep& end, int tree, const TreeMotion& motion,
                 HeldMotion& now);

  const mjModel_* model_;
  std::vector<int> first_;  // by tree, see coupled_energy.hpp; -1 without a Verlet corrector
  HoldingRows holding_rows_;
  CommonTranslations translations_;
  DriveChanges drives_;
  std::vector<char> left_corrector_;                               // by tree
  std::vector<CoupledEnergy> coupled_;                             // by first tree
  std::vector<double> wrench_, force_, corrector_, added_;         // by motion coordinate
  std::vector<double> load_response_;                              // of one tree, by the same
  std::vector<double> generalized_, momentum_, momentum_of_half_;  // by degree of freedom
  // By the same, where rows may hold trees: forces that have a potential, and what linear springs
  // of single joints have of them.
  std::vector<double> potential_, joint_spring_;
  struct {
    std::vector<double> motion, momentum;  // generalized, of all trees
  } translation_;
  // What springs and drives have of the Verlet corrector.
  struct {
    std::vector<double> rest, way;  // by degree of freedom, see CoupledEnergy
    std::vector<double> half;       // of one tree, by motion coordinate
  } springs_;
  // By tree: when (s) the contacts that may hold it are frozen, 0 where at the start; whether it
  // has light parts. By degree of freedom: what gravity changes by until then. Room.
  std::vector<double> frozen_at_, gravity_load_, gravity_room_;
  std::vector<char> light_;
  double fastest_turn_ = 0.0;
};

}  // namespace dashpot
