// Micro-steps of one island over its rows, with geometry frozen (DESIGN section 2.4).
//
// State is whitened (rows.hpp): velocity y, smooth acceleration y_a. A micro-step of length h:
//
//     u  = Jw y                                   gap rates
//     F  = force every contact has now            from its deformation and rate
//     b  = Jw (y_a + Jw' F) - w F                 load on each row, its own share left out
//     p, r                                        closed-form flow of each row over h, friction
//                                                 returned to its limit surface
//     y += h y_a + Jw' p,   displacement = h y + h^2/2 y_a + Jw' r
//
// Work. Impulses p and moments r change kinetic energy by p (u_0 + u_1) / 2 and, displacing the
// bodies by r, change the work of the smooth forces; together row i does the work
//     p (u_0 + u_1) / 2 + (Jw y_a) (h p / 2 - r) ,
// which closes the ledger to rounding for a single contact.
//
// Statics are exact, since at rest F carries every load, and contacts know of each other through F.
// The cost is linear in the number of contacts; nothing iterates.

#pragma once

#include <vector>

#include "dashpot/kelvin_voigt.hpp"
#include "dashpot/rows.hpp"

namespace dashpot {

// Trees and row groups coupled to each other, and the micro-steps they take.
struct Island {
  std::vector<int> tree;   // indices in Trees
  std::vector<int> group;  // indices in Rows::group
  int microsteps = 1;
  double duration = 0.0;  // h, s
  int clipped = 0;        // rows whose stiffness or damping was lowered to what h resolves
};

// Energies (J) of contact normals, of friction, and of limits, equalities and dry friction loss.
struct EnergyShares {
  double normal = 0.0, friction = 0.0, constraint = 0.0;
  double sum() const { return normal + friction + constraint; }
};
// The share that the energy of row i of a group belongs to.
double& share(EnergyShares& shares, const RowGroup& group, int i);

// What the micro-steps change.
struct RowData {
  // Per row. `deformation` is the spring gap x of a normal or limit (negative when compressed),
  // the strain of an equality, the elastic displacement s of a friction row; m or rad.
  std::vector<double> deformation, rate, force, impulse, moment;
  std::vector<double> total_impulse;    // over the whole step, N s or N m s
  std::vector<double> smooth_load;      // Jw y_a, m/s^2 or rad/s^2
  std::vector<double> relaxation;       // of a spring whose slider slips: exp(-k h / d)
  std::vector<Propagator> propagator;   // of normals and limits
  std::vector<LinearFlow> linear_flow;  // of all other rows

  // Per group: unstressed part of the position still to recover (deformation minus position; >= 0
  // for contacts and limits), whether friction last stuck, whether any impulse acted in this step.
  // `surface` is the rate at which the offset shrinks in the present micro-step.
  std::vector<double> offset, surface;
  std::vector<char> sticking, touched;

  // Whitened, per degree of freedom.
  std::vector<double> velocity, smooth_acceleration, displacement, total_displacement, acceleration;

  // Work done on the bodies, and energy put in by recovery, J.
  EnergyShares work, recovery_input;

  // Size and zero the arrays per degree of freedom, and those per row and group.
  void reset_motion(int dofs);
  void reset_rows(const Rows& rows);
};

void run_microsteps(const Rows& rows, const Trees& trees, const Island& island,
                    double recovery_speed, RowData& data);

// Whether a separated limit or contact would overlap after `time` (s) of MuJoCo's semi-implicit
// update, which moves a row load time^2 / 2 farther than its parabola. `velocity` and
// `acceleration` are whitened, of the start and smooth.
bool overlaps_semi_implicitly(const Rows& rows, const RowGroup& group, double gap,
                              const double* velocity, const double* acceleration, double time);

// Whether no row of an island can act within `time` (s): all are unilateral, separated, and stay so
// in their smooth motion, by either update. Such an island needs no micro-steps.
bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data);

// Elastic energy stored in the springs, J.
EnergyShares elastic_energy(const Rows& rows, const RowData& data);

}  // namespace dashpot
