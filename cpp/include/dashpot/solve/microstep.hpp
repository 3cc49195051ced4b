// Micro-steps of islands over their rows, with geometry frozen.
//
// State is in motion coordinates (trees.hpp): velocity v, smooth acceleration a. A micro-step h:
//
//     u  = J v                                    gap rates
//     F  = force every contact has now            from its deformation and rate
//     b  = J (a + inv(H) J' F) - w F              load on each row, its own share left out
//     p, r                                        closed-form flow of each row over h, friction
//                                                 returned to its limit surface
//     u' = J v'  with  v' = v + h a + inv(H) J' p
//     x += h u + h^2/2 b + w r + s h (u' - u - h b - w p),   s = 1/3
//
// A row's displacement is that of its own flow, and what the forces of others add to it by
// changing: where they change linearly, a third of h times the velocity that they add. The motion
// of the bodies is exact: over all micro-steps they move by the sum of h v + h^2/2 a + inv(H) J' r,
// and the springs meet that in the end.
//
// Dampers. Those that the integrator treats implicitly act along with the rows: with f the smooth
// forces at the velocity v0 of the start, and H = M + e D,
//
//     M v' = f - D (v + e v' - v0) + J'F,
//
// so that beside F there is the drag D ((T - e) a - (v - v0)), T the length of the step and a =
// inv(M + T D) f what MuJoCo's integrator makes of f. Held over the step, dampers would act half a
// step late: from what rows swing by the angle z in a step they would take sin z / z of what they
// ought to, which drives it for z from pi to 2 pi, and just below pi it would settle into motion
// that turns round in every step.
//
// Springs of joints, K, act along, too: beside F there is their pull
//
//     -K (x + h v / 2),    x' = x + h (v + v') / 2,
//
// x: how far the tree has gone; held over the step they would add some K (x1 - x0)^2 / 2 to what a
// hit throws back in it.
//
// Work. Impulses p and moments r change kinetic energy by p (u_0 + u_1) / 2 and, displacing the
// bodies by r, change the work of the smooth forces; together row i does the work
//     p (u_0 + u_1) / 2 + (J a) (h p / 2 - r) ,
// which closes the ledger to rounding for a single contact.
//
// Statics are exact, since at rest F carries every load, and contacts know of each other through F.
// The cost is linear in contacts; nothing iterates. Rows act on wrenches: J' gathers them by body,
// and inv(H) is applied once per tree. Groups of rows go four at a time (lane_flow.hpp); their
// order, so every sum, is that of the island and of its slices (island_blocks.hpp).

#pragma once

#include <memory>
#include <vector>

#include "dashpot/islands/islands.hpp"
#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Runs the micro-steps of islands. Keeps its arrays from step to step.
class MicrostepLoop {
 public:
  explicit MicrostepLoop(int threads);
  ~MicrostepLoop();

  // Runs the micro-steps of all islands in which a row may act within the `time` (s) of the step,
  // and moves all other trees that are `linked` (by tree) and fly. Threads share large islands, and
  // have small ones to themselves, those that follow each other and flow alike as one; the team has
  // no more than `threads`.
  void run(const Rows& rows, const Trees& trees, const std::vector<Island>& islands,
           const std::vector<char>& linked, double recovery_speed, double time, RowData& data,
           Team& team);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dashpot
