// Where the springs of limits and equalities are by their positions: of those that grow stiffer on
// their way, where one as stiff as the row bears the load that belongs to the position
// (islands/solref_load.hpp). They store what they took from bodies, and what they had lost before,
// but no more: where steps do not resolve how they grow stiffer nothing is gained.

#pragma once

#include <cstddef>

#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/step_view.hpp"

namespace dashpot {

// Whether a limit or equality of which nothing is remembered, and whose solref the model sets,
// begins with what its spring bears: an equality, which users switch on, in any step, a limit in
// the first of all.
bool begins_stretched(const Memory& memory, const ConstraintInput& input, const RowGroup& c);

// The position (m or rad) of a spring, and the energy (J) that this stands for.
struct SpringPlace {
  double position, stored;
};
// One that steps do not resolve has its own position, and a load of its own.
SpringPlace place_of_spring(const ConstraintInput& input, const Rows& rows, const RowGroup& c);

// Whether rows that have one impedance, from group `first` on, grow stiffer on their way.
bool grows_stiffer(const StepView& step, const Rows& rows, size_t first);
// What part of their places they may be deformed by, and the `energy_tank` (J) that is left of what
// they had lost.
double part_of_places(const StepView& step, const Rows& rows, size_t first, double& energy_tank);

}  // namespace dashpot
