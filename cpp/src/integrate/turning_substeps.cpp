#include "dashpot/integrate/turning_substeps.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/model/host.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

bool is_far(double turn, double bend) {
  return bend > kFollowedBend && turn + bend > kFollowedTurn;
}

double equal_substep(double count, double rest, double whole) {
  return std::min(rest, std::max(rest / std::ceil(count), whole / kMostSubsteps));
}

}  // namespace

double substep_of_smooth_turn(const mjModel_* m, const mjData_* d, TreeMotion& motion,
                              const double* held, const StepClock& clock) {
  const double rest = clock.length, whole = clock.whole;
  double count = 1.0;
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (motion.is_accurate(index)) continue;
    // The stages of RK4 are followed twice as far.
    const double share = host::is_runge_kutta(m) && !motion.linked()[index] ? 0.5 : 1.0;
    const Tree& tree = motion.trees().tree[index];
    double fastest = 0.0;
    for (int dof = tree.dof_begin; dof < tree.dof_begin + tree.dof_count; ++dof) {
      const double turn = share * rest * std::abs(motion.start_velocity()[dof]);
      const double bend = share * rest * rest * std::abs(motion.smooth_acceleration()[dof]);
      if (host::is_rotational(m, dof)) {
        fastest = std::max(fastest, turn);
        if (is_far(turn, bend))
          count = std::max({count, turn / kSubstepTurn, std::sqrt(bend / kFollowedBend)});
      }
    }
    if (held && held[index] > 0.0)
      count = std::max(count, rest * host::fastest_carried_axis(d, tree) / kSubstepTurn);
    const double turn = fastest * whole / rest;
    if (turn > kFollowedTurn && !tree.free_body &&
        turn * share * whole * motion.translation_by_turning(d, index) > kFollowedBend)
      count = std::max(count, fastest / kSubstepTurn);
  }
  return equal_substep(count, rest, whole);
}

double substep_of_thrown_turn(const mjModel_* m, const TreeMotion& motion, const RowData& data,
                              const std::vector<char>& touched, const StepClock& clock) {
  const double rest = clock.length;
  double count = 1.0;
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!touched[index] || motion.is_accurate(index)) continue;
    const Tree& tree = motion.trees().tree[index];
    for (int i = 0; i < tree.dof_count; ++i) {
      const int dof = tree.dof_begin + i;
      const double end = data.velocity[tree.begin + i];
      const double turn = rest * std::abs(end);
      const double bend = rest * std::abs(end - motion.start_velocity()[dof]);
      if (turn > kFollowedTurn && is_far(turn, bend) && host::is_rotational(m, dof))
        count = std::max(count, turn / kSubstepTurn);
    }
  }
  return equal_substep(count, rest, clock.whole);
}

double substep_of_turning_rows(double turn, const StepClock& clock) {
  return turn > kSubstepTurn ? equal_substep(turn / kSubstepTurn, clock.length, clock.whole)
                             : clock.length;
}

}  // namespace dashpot
