// What a stepper holds. The step is in engine.cpp; how far its substeps go in substep_length.cpp,
// their rows in substep_rows.cpp and row_assembly.cpp, the state at the end in state.cpp. Forces of
// rows are in step_forces.hpp, what becomes of energy in energy_accounting.hpp, and what sleeps in
// sleeping_trees.hpp. What is virtual is another thing under the complementarity-free law
// (comfree_stepper.hpp).

#pragma once

#include <vector>

#include "dashpot/detect/detection.hpp"
#include "dashpot/impacts/flight_contacts.hpp"
#include "dashpot/impacts/impact.hpp"
#include "dashpot/impacts/impact_propagation.hpp"
#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/islands/tied_mass.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/mocap_motion.hpp"
#include "dashpot/model/row_turns.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/solve/microstep.hpp"
#include "dashpot/step/contacts.hpp"
#include "dashpot/step/engine.hpp"
#include "dashpot/threads/pace.hpp"
#include "dashpot/threads/team.hpp"
#include "energy_accounting.hpp"
#include "sleeping_trees.hpp"
#include "solved_substep.hpp"
#include "step_forces.hpp"

namespace dashpot {

struct Stepper::Impl {
  // `own`: trees move as the micro-steps do, not as MuJoCo moves them.
  Impl(mjModel_* m, const Parameters& p, int threads, bool own = true);
  virtual ~Impl() = default;

  // A step and its substeps (engine.cpp).
  StepStats step(mjData_* d, bool leave_rows);
  StepStats take_step(mjData_* d, bool leave_rows);
  virtual void complete_last_step(mjData_* d);
  void follow_edits();
  bool in_touch(mjData_* d) const;
  void advance(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap);
  void start_substep(mjData_* d, bool new_control, host::Sensors sensors, bool rough,
                     host::MocapMotion& mocap);
  void detect(mjData_* d, host::MocapMotion& mocap);

  // How far a substep goes (substep_length.cpp).
  virtual void solve_substep(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap);
  double length_of_turns(mjData_* d);
  double length_of_what_came();
  bool shorten(double shorter, host::Substeps& substeps);
  void detect_and_solve(mjData_* d, host::Substeps& substeps, host::MocapMotion& mocap);
  bool is_rough(const host::Substeps& substeps) const;
  void cut_at_impact(mjData_* d, host::Substeps& substeps);
  void propagate_impacts(mjData_* d, host::MocapMotion& mocap);
  void find_mean_velocity();

  // What sleeps.
  bool wake_reached(mjData_* d, const host::MocapMotion& mocap);
  void fall_asleep(mjData_* d, const host::MocapMotion& mocap);

  // Contacts, beside those that detection finds.
  virtual void correct_contacts_ahead(mjData_* d);

  // Rows, and the geometry that they have.
  void find_rows(mjData_* d, host::MocapMotion& mocap);
  void solve(mjData_* d, host::MocapMotion& mocap);
  void build_rows_in_the_middle(mjData_* d, const std::vector<GeomPair>& apart,
                                host::MocapMotion& mocap);
  virtual void freeze_within_step(mjData_* d);
  void freeze_turning_contacts(mjData_* d);
  HitFrequency hit_frequency() const;
  void build_rows(mjData_* d);
  void act_along_in_links(mjData_* d);

  // What rows do over the substep.
  virtual void finish_last_step(mjData_* d);
  virtual void act(mjData_* d);
  void plan_rows(const StepView& step);
  void plan_and_recall(mjData_* d);
  double resolved_length() const;
  void run_islands(mjData_* d);
  void check_velocities() const;
  void check_memory(mjData_* d) const;
  void find_touched_trees();
  void find_end_of_contacts();

  // The state at the end of the substep (state.cpp), and the forces that lead there.
  void find_forces(mjData_* d);
  virtual void report_forces(mjData_* d);
  void integrate_by_mujoco(mjData_* d);
  virtual void advance_state(mjData_* d);
  RowsOnTree rows_on_tree(int tree) const;

  // What is kept of the substep, and told of it.
  void forget_moved_by_hand(mjData_* d, std::vector<double>& before);
  void remember(mjData_* d, const host::MocapMotion& mocap);
  Memory memory(mjData_* d) const;
  StepView view(mjData_* d) const;
  SolvedSubstep solved_substep() const;

  Team team;
  Pace pace;
  mjModel_* model;
  Parameters parameters;
  MemoryLayout memory_layout;
  long long data_size;
  host::KeptModel kept_model;
  bool may_have_rows = false;
  bool differentiable = false;
  TreeMotion motion;
  Trapezoid trapezoid;

  // Found anew in every step or substep, or kept from one to the next for their arrays.

  // Detection, and where it ends the substep.
  StepClock clock;
  Substep substep;
  FlightContacts flights;
  ImpactPropagation propagation;
  std::vector<double> mean_velocity, end_gap;  // (nv); by contact, m
  host::Detection detection;
  const host::FindContacts find_contacts = [this](mjModel_* m, mjData_* d) {
    host::find_present_contacts(m, d, detection);
  };
  host::MocapBuffers mocap_buffers;

  SleepingTrees sleeping;

  // Rows, their material and geometry.
  std::vector<ContactInput> contacts;
  std::vector<ConstraintInput> constraints;
  bool geometry_of_middle = false;  // of the substep, not of its start
  std::vector<double> tree_ahead;   // by tree: s, its inertia is of then; 0: the start
  host::RowTurns row_turns;
  Rows rows;
  std::vector<GroupMaterial> materials;  // per group
  std::vector<Match> matches;            // per group

  // How they are solved, per group but for the first two.
  Islands islands;
  TiedMass tied_mass;
  std::vector<DeflectionTime> deflection_times;
  std::vector<char> stays_open;
  std::vector<double> compression;  // of the mode that damps it, m

  // What they do.
  RowData data;
  MicrostepLoop microsteps{team.size()};
  RowsOnTrees on_trees;
  int to_remember = 0;           // contacts that are compressed before positions recover
  std::vector<int> compressed;   // groups of contacts, at the end of the substep
  StepStats stats;               // of the substep
  std::vector<double> recovery;  // by motion coordinate: displacement that equalities recover
  StepForces forces;
  EnergyAccounting accounting;
};

}  // namespace dashpot
