// How much of a step MuJoCo's integrators follow trees that turn far.
//
// They take Coriolis and centrifugal forces as those of the start of the step; and rows act in the
// geometry of its start. Where links turn by h w (rad) about several axes, that adds to their
// energy in every step. So a step in which a joint both turns far and changes its velocity,
//
//   turn = h |w|,  bend = h^2 |dw/dt|,  bend > kFollowedBend,  turn + bend > kFollowedTurn,
//
// is taken in equal substeps, of which neither turns farther than kSubstepTurn nor bends farther
// than kFollowedBend, but in kMostSubsteps at most. A wheel that spins does not bend its way,
// however fast it is, and steps as in MuJoCo.
//
// Slides and free joints go straight while what they carry turns about an axis beside its centre of
// mass: that hinge keeps its velocity, and the centrifugal acceleration a_t of the others turns
// with it. So of a whole tree there is, with its fastest turn and in the norm of its inertia,
//
//     bend = turn h |a_t| / |v|,    a_t: what translations have of the acceleration by bias alone,
//
// since weight and drives do not turn.
//
// Of trees that rows hold, what joints hang on carries their axes along, and with them the axes
// along which weight and contacts cancel. The rows have those of the middle, H and what joints damp
// those of the start. So a step that carries an axis on by more than kSubstepTurn has substeps.
//
// Equalities turn with what they couple, and the velocities at the end of a step, which lack its
// Verlet corrector (trapezoid.hpp), have an energy that is off by half the square of the angle. So
// a step in which the row of one turns by more than kSubstepTurn, dJ/dt xi H over the speed that
// the kinetic energy of all could give it, is taken in substeps, too.

#pragma once

#include <vector>

#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/row_data.hpp"

namespace dashpot {

inline constexpr double kFollowedTurn = 0.3;   // rad in a step
inline constexpr double kFollowedBend = 0.02;  // rad
inline constexpr double kSubstepTurn = 0.1;    // rad
inline constexpr int kMostSubsteps = 64;

// The length (s) of the next substep, at most that of the present one, by the smooth motion
// over that; the same where nothing turns far. `held`: by tree, HeldMotion::held, or null.
double substep_of_smooth_turn(const mjModel_* m, const mjData_* d, TreeMotion& motion,
                              const double* held, const StepClock& clock);

// The same by the velocities that rows have given the trees that they `touched` (by tree) in the
// present substep: what a blow throws far within a step turns as far as it will go on to.
double substep_of_thrown_turn(const mjModel_* m, const TreeMotion& motion, const RowData& data,
                              const std::vector<char>& touched, const StepClock& clock);

// The same where a row of an equality turns by `turn` (rad) in the present substep.
double substep_of_turning_rows(double turn, const StepClock& clock);

}  // namespace dashpot
