// Recovery of equalities by displacement.
//
// Where the position of an equality row and the strain its spring remembers differ, the difference
// o (its unstressed offset) is the error of geometry frozen over a step or of the initial state.
// A surface that moved back at some speed would push bodies at that speed: near a singular
// configuration, where little of the apparent mass moves along the row, that means fast bodies,
// whose turning makes the next offset, so a straight chain connected at both ends gained energy
// without bound. Displacing the bodies instead gives them no velocity. With t the offsets, limited
// to what the recovery speed covers in a step,
//
//     d = inv(H) J' e ,   (A + R) e = t ,   A = J inv(H) J' .
//
// For equalities R = max(w / 100, typical w - w), which keeps displacements small near singular
// configurations and where rows contradict each other. Springs of contacts, limits and sticking
// friction take part with t = 0 and resist as they would over a step of length H, R = 1 / (k H^2),
// so that recovery moves bodies along what holds them. All springs follow what the displacement
// does beyond t.

#pragma once

#include <vector>

#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

struct Island;

// The displacement of the trees of an island whose equalities have offsets, after its micro-steps
// over `time` (s), is added to `displacement` (zero there before; motion coordinates). Returns the
// energy that the springs of other rows took up by following it, J.
double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement);

}  // namespace dashpot
