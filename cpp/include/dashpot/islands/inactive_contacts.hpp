// Contacts and limits that are found ahead, but stay open.
//
// Detection looks as far as bodies may come in a step, whatever hits them meanwhile. What is found
// there acts on nothing; but in the bound on the coupling of their rows (row_stiffness.hpp) it
// would make all rigid rows of its trees softer, and change them from step to step. So bounds leave
// out a group of gap g in a
// step H with
//
//     g >= kMayMeet H (v_1 + v_2) ,
//
// v_T being the fastest that any gap of tree T closes: what one impulse does to the others. If more
// than that happens to it, its rows are too stiff in that step for a resolution of theta = 1, where
// micro-steps are stable up to 2. What hits and turns may be thrown at anything: trees with gaps
// that close or open as fast as hits do (hit_speed) leave out nothing. Nor do islands of few groups
// that are hit: the blow runs through them, as through a row of balls, on springs of one stiffness.

#pragma once

#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class InactiveContacts {
 public:
  // From the velocities and smooth accelerations in `data`.
  void find(const StepView& step, const Rows& rows, const std::vector<Island>& islands,
            int tree_count, const RowData& data);
  // Per group: whether it is a contact or limit that stays open.
  const std::vector<char>& stays_open() const { return stays_open_; }

 private:
  static constexpr double kUnasked = -1.0;
  void find_fastest(const Rows& rows, const RowGroup& group, double length, const RowData& data);

  // Per tree, m/s or rad/s: infinite where it flies, kUnasked where it has no inactive contact.
  std::vector<double> fastest_;
  std::vector<char> stays_open_;
};

}  // namespace dashpot
