// Positions that lead by half a step.
//
// MuJoCo's semi-implicit integrators, which move trees that no row holds,
//
//     v' = v + H a(q, v),    q' = q + H v',
//
// are leapfrog: q is the position of half a step after v. Trees that rows hold have both in time.
// Taken for each other, they cost the energy H f v / 2, f the smooth forces, wherever a tree lands
// and where it leaves again. So a tree that rows hold after a step by MuJoCo's integrator begins
// where it is in time, with the gaps that it has there, and one that leaves its rows at the end of
// a step ends ahead:
//
//     q - (l v + l^2 a / 2),    q' + (l v' + l^2 a' / 2),    l = H / 2,
//
// a the smooth acceleration there, with that of linear springs. One whose rows are still compressed
// at the end of a step, and hold it no more in the next, where geometry has them apart, goes l v
// ahead in that. Neither does where this, or the next step after it, would take it into a row:
// micro-steps move it in time, as if the row held it, until it lands or has room. Momentum is
// that of the forces, always. Contacts are seen where velocities lead from q until the middle of
// the step, which is H / 2 less far, and rows have the times of where trees fell back to. Free
// bodies and RK4 do not lead.

#pragma once

#include <vector>

#include "dashpot/motion/tree_motion.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;

namespace dashpot {

class Leapfrog {
 public:
  // At the start of a step, before all else: the leads that the last step left.
  void find_leads(const mjModel_* model, const Memory& memory, const TreeMotion& motion);
  // By tree, s.
  const std::vector<double>& lead_at_start() const { return lead_at_start_; }
  // After the rows of a step have their deformations: takes trees that may be held back to where
  // they are in time, by the displacements and the gaps in `data`.
  void fall_back(const Memory& memory, const TreeMotion& motion, Rows& rows, RowData& data);
  // After the micro-steps of a part whose length without cuts at impacts is `stride` (s, see
  // StepClock): takes trees that leave their rows ahead. `held`, by tree: rows that have a position
  // moved it.
  void go_ahead(double stride, const std::vector<char>& held, const TreeMotion& motion,
                const Rows& rows, RowData& data);

  // By tree: the lead (s) that it gave up as it fell back, 0 where it did not; and how far that
  // was, by motion coordinate.
  const std::vector<double>& fell_back() const { return fell_back_; }
  const AlignedDoubles& way_back() const { return way_back_; }

  // By motion coordinate: how far trees that rows held in the last step, and did not in this one,
  // go ahead besides their motion; null for all others.
  const double* late_way(int tree) const { return leads_late_[tree] ? late_way_.data() : nullptr; }

  // By tree: the last step left it in time, and MuJoCo's integrator moves it where no row does.
  const std::vector<char>& in_time() const { return in_time_; }

  // Keeps in `memory` the leads at the end of the step.
  void keep(double stride, const std::vector<char>& held, const TreeMotion& motion,
            Memory& memory) const;

 private:
  // The smooth acceleration of a tree after a `way` from where the step starts, on which its linear
  // springs change.
  void find_acceleration(const Trees& trees, int index, const AlignedDoubles& way,
                         const RowData& data);
  // Marks trees that recover from overlap, most of which no spring holds: they do not lead.
  void find_recovering(const Rows& rows, const RowData& data);
  // Shifts trees that the last step left ahead back; whether there are any.
  bool find_way_back(const TreeMotion& motion, RowData& data);
  // Gives rows the deformations and offsets that they have where trees are in time.
  void take_gaps_back(const Rows& rows, RowData& data);
  void take_times_back(Rows& rows) const;

  // Trees that may go ahead in this step, where no row holds them.
  void find_late(double stride, const std::vector<char>& held, const TreeMotion& motion,
                 const Rows& rows, const RowData& data);
  void find_next_way(double stride, const AlignedDoubles& velocity, const RowData& data,
                     const AlignedDoubles& ahead);

  // By tree: MuJoCo's integrator moves it where no row does; it is in time, as the last step left
  // it; it leads at the end of this one, as it leaves its rows, or because it left them before and
  // no row bars it; it recovers from overlap, most of which no spring holds.
  std::vector<char> leapfrogs_, in_time_, leads_, leads_late_, recovers_;
  std::vector<double> lead_at_start_, fell_back_;  // by tree, s
  std::vector<double> start_gap_;                  // of the deformations of rows
  // By motion coordinate: how far those that lead, and those that do so late, go ahead, and where
  // the next step would take them.
  AlignedDoubles way_ahead_, late_way_, next_way_, start_velocity_;
  AlignedDoubles way_back_;             // by the same, see way_back()
  AlignedDoubles acceleration_, pull_;  // of find_acceleration
};

}  // namespace dashpot
