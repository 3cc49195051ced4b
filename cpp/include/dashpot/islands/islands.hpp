// Islands and the control of their micro-steps.
//
// Groups with a tree in common are coupled; an island is a connected set of them. Its micro-step
// h must resolve the coupled stiffness and damping:
//
//     h sqrt(lambda_max(K^1/2 A K^1/2)) <= theta,    h lambda_max(D^1/2 A D^1/2) <= theta,
//     A = J inv(H) J',   theta = kResolution .
//
// The bound on lambda_max is that of coupled_sum.hpp, of rigid rows without those that stay open.

#pragma once

#include <array>
#include <vector>

#include "dashpot/islands/coupled_sum.hpp"
#include "dashpot/islands/group_material.hpp"
#include "dashpot/islands/row_stiffness.hpp"
#include "dashpot/law/parameters.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

inline constexpr double kResolution = 0.6;  // theta
// Of "auto": with 10, boxes that are pushed creep while they are rocked.
inline constexpr int kMinimumMicrosteps = 13;
// Rigid contacts last some three micro-steps when they are hit, too few for what friction and other
// contacts do meanwhile. An island of few groups that is hit takes so many times as many
// micro-steps with "auto", at most max_microsteps, and its rigid rows get no stiffer for it. Where
// two bodies hit each other alone they are only as stiff as a third of its micro-steps resolves,
// but at least kFewestOfHits.
inline constexpr int kMicrostepsOfHits = 3;
inline constexpr double kFewestOfHits = 4.0;  // a hit then lasts two thirds of the step
inline constexpr int kFewGroups = 24;         // of an island

// Of an island that is hit and would take `of_step` micro-steps otherwise: how many it takes, and
// how many longer ones its rigid rows are as stiff for if two bodies hit each other alone.
struct HitMicrosteps {
  int count = 0;
  double stiff_for = 0.0;
};
HitMicrosteps microsteps_of_hit(int of_step, const Options& options);

// A range of indices.
struct Indices {
  const int* first = nullptr;
  const int* last = nullptr;
  const int* begin() const { return first; }
  const int* end() const { return last; }
};

// Trees and row groups coupled to each other, and the micro-steps they take.
struct Island {
  Indices tree;   // in Trees
  Indices group;  // in Rows::group
  int microsteps = 1;
  double duration = 0.0;        // h, s
  double rigid_duration = 0.0;  // of micro-steps that rigid rows are as stiff for, s
  bool hit = false;             // a rigid contact or limit of it is
  int clipped = 0;              // rows whose stiffness or damping was lowered to what h resolves
  int group_count() const { return static_cast<int>(group.last - group.first); }
  bool has_few_groups() const { return group_count() <= kFewGroups; }
};

// Whether no row of an island can act within `time` (s): all are unilateral, separated, and stay so
// in their smooth motion, by either update. Such an island needs no micro-steps.
bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data);

// What micro-steps are planned for.
struct MicrostepDemand {
  const std::vector<GroupMaterial>& materials;         // per group
  const std::vector<DeflectionTime>& deflection_time;  // per group
  const std::vector<char>& stays_open;                 // per group (island_hits.hpp)
  const RowData& data;                                 // which groups are hit
  double part, step;  // s, what is planned, of a step of what length
  const Options& options;
};

// Finds islands and plans their micro-steps. Keeps its arrays from step to step.
class Islands {
 public:
  // Connected sets of groups in a fixed order: by their first group. Valid until the next call.
  const std::vector<Island>& find(const Rows& rows, const Trees& trees);

  // Chooses the number of micro-steps of every island and fills the stiffness and damping of its
  // rows. These are those of the whole step, so that what rests does not feel its parts. A rigid
  // material becomes as stiff as h resolves, one of a model's own solref no stiffer than that says.
  // Where h does not resolve an island's SI values, all its rows are rigid, those no stiffer than
  // given. What is lowered is counted as clipped.
  void plan(Rows& rows, const Trees& trees, const MicrostepDemand& demand, Team& team);

  const std::vector<Island>& all() const { return islands_; }

 private:
  // Bounds of one tree: SI stiffness, SI damping, and rigid rows weighted by 1/w.
  struct TreeBounds {
    double stiffness = 0.0, damping = 0.0, rigid = 0.0;
    RigidCoupling coupling;
    bool mixed() const { return rigid > 0.0 && (stiffness > 0.0 || damping > 0.0); }
    // Fraction of the resolution that SI rows may use, and that rigid rows may use.
    double si_share() const { return rigid > 0.0 ? 0.5 : 1.0; }
    double rigid_share() const { return mixed() ? 0.5 : 1.0; }
  };
  void sort_sides(const Rows& rows, int tree_count);
  void measure(const int* first_tree, const int* last_tree, const Rows& rows, const Trees& trees,
               const MicrostepDemand& demand, bool all_rigid, Team& team);
  void add_sides(int tree, const Rows& rows, const Trees& trees, const MicrostepDemand& demand,
                 bool all_rigid);
  void take_bounds(int tree, const Trees& trees, CoupledSum::Room& room);
  double longest_si_microstep(const Island& island) const;
  double longest_rigid_microstep(const Island& island) const;
  // Chooses the micro-steps of an island; returns whether they are so many that friction needs to
  // take no resolution from the damping of normals.
  bool choose_microsteps(Island& island, const MicrostepDemand& demand);
  RigidCoupling rigid_coupling(const RowGroup& group) const;

  std::vector<Island> islands_;
  std::vector<int> root_, island_of_, tree_of_, tree_order_, group_order_, first_;
  // Twice a group and its side, 0 or 1, by tree that this side is of: from first_side_[tree] on.
  std::vector<int> side_order_, first_side_;
  std::vector<std::array<int, 2>> trees_of_order_;  // by place in group_order_
  std::vector<std::array<double, 2>> split_;        // by row: its weight on both sides
  std::vector<TreeBounds> bounds_;                  // by tree
  std::vector<double> rigid_longest_;               // by group: microstep that resolves it, s
  std::vector<char> resolves_;                      // by island: its SI values
  std::vector<int> island_at_;                      // by place in group_order_
  std::vector<char> lowered_;           // by place in group_order_: its stiffness or damping
  std::vector<CoupledSum::Room> room_;  // by worker
  CoupledSum stiffness_, damping_, rigid_normal_, rigid_friction_;
};

}  // namespace dashpot
