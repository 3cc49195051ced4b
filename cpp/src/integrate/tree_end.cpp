// Where trees are at the end of a step, see tree_motion.hpp.

#include <algorithm>

#include "dashpot/integrate/tree_motion.hpp"
#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot {

namespace {

// Turn in a step (rad) below which the inertia of its start is good, and fraction of a body's
// kinetic energy that contacts may give it because they turn though no spring pays: what rolls gets
// that back, and elastic hits of less turn give up to all of it.
constexpr double kFarTurn = 0.2;
constexpr double kMostUnpaid = 0.01;
// Turn (rad) up to which its energies differ by rounding alone.
constexpr double kStillTurn = 1e-5;

}  // namespace

void TreeMotion::add_velocity(mjData_* d, int index, const double* change) {
  const Tree& tree = trees_.tree[index];
  end_velocity_.resize(tree.dof_count);
  to_generalized(index, change + tree.begin, end_velocity_.data());
  host::add_velocity(d, tree, end_velocity_.data());
}

double TreeMotion::advance(mjData_* d, int index, double length, const RowsOnTree& by_rows,
                           RowData& data) {
  if (sleeps(index)) return 0.0;
  if (host::is_free_body(model_, index)) return advance_free_body(d, index, length, by_rows, data);
  if (!linked_[index]) return 0.0;
  const Tree& tree = trees_.tree[index];
  const double* moved = data.total_displacement.data() + tree.begin;
  const double* velocity = data.velocity.data() + tree.begin;
  host::write_tree(model_, d, tree, start_position_.data(), moved, velocity);
  return 0.0;
}

// Seen from the geometry of the middle, or from the start of a step in which the body turns far,
// its inertia differs from what it is where contacts act. What this would add to its energy is
// taken out of its rotation, and what that has not, out of what the ground gave its translation:
// two bodies keep their momentum. So is what springs did not give, of a body that turns far, or
// where it is much. Returns what the body lacks of the work of the rows.
double TreeMotion::advance_free_body(mjData_* d, int index, double length,
                                     const RowsOnTree& by_rows, const RowData& data) {
  const Tree& tree = trees_.tree[index];
  const FreeMotion& motion = free_motion_[index];
  Vector6 velocity_change = Vector6::Zero(), shift = Vector6::Zero();
  if (by_rows.touched) {
    // What contacts added to the smooth motion.
    double change[kBodyCoordinates], move[kBodyCoordinates];
    for (int i = 0; i < tree.count; ++i) {
      const double velocity = data.start_motion[tree.begin + i];
      const double acceleration = data.smooth_acceleration[tree.begin + i];
      change[i] = data.velocity[tree.begin + i] - velocity - length * acceleration;
      move[i] = data.total_displacement[tree.begin + i] -
                length * (velocity + 0.5 * length * acceleration);
    }
    velocity_change = without_zeros(change);
    shift = without_zeros(move);
    if (!tree.free_body) {
      velocity_change = motion_of_centre(motion, Eigen::Map<const Vector6>(change));
      shift = motion_of_centre(motion, Eigen::Map<const Vector6>(move));
    }
  }
  FreeBody end = finish_free_motion(motion, length, velocity_change, shift);
  double lost = 0.0;
  const double turn =
      length * std::max(motion.angular_velocity.norm(), end.velocity.tail<3>().norm());
  const bool turns_far = turn > kFarTurn, is_braked = by_rows.frozen_ahead || turns_far;
  if (by_rows.touched && turn > kStillTurn && (is_braked || !by_rows.trapezoidal)) {
    const bool counts = turns_far || by_rows.unpaid > kMostUnpaid * kinetic_energy(end);
    const double unpaid = counts ? by_rows.unpaid : 0.0;
    const double excess = energy_gain(motion, shift, end) - contact_work(index, length, data);
    const double surplus = is_braked ? excess + unpaid : 0.0;
    double taken = 0.0;
    if (surplus > 0.0) taken = brake_rotation(end, surplus);
    if (taken < surplus && !by_rows.joined)
      taken += brake_translation(end, velocity_change.head<3>(), surplus - taken);
    lost = taken - excess;
    if (by_rows.trapezoidal) lost = std::clamp(lost, 0.0, unpaid);  // it has the rest
  }
  host::write_free_body(model_, d, index, end);
  return lost;
}

// Work of rows on a free body in the frozen geometry: kinetic energy less work of the smooth load.
double TreeMotion::contact_work(int index, double length, const RowData& data) const {
  const Tree& tree = trees_.tree[index];
  const auto centre = [&](const AlignedDoubles& coordinates) -> Vector6 {
    const double* own = coordinates.data() + tree.begin;
    if (tree.free_body) return without_zeros(own);
    return motion_of_centre(free_motion_[index], Eigen::Map<const Vector6>(own));
  };
  const Vector6 twice_mean = centre(data.start_motion) + centre(data.velocity);
  const Vector6 load = wrench_of(free_motion_[index], centre(data.smooth_acceleration));
  double work = load.dot(0.5 * length * twice_mean - centre(data.total_displacement));
  for (int i = tree.begin; i < tree.begin + tree.count; ++i)
    work += 0.5 * data.coordinate_impulse[i] * (data.start_motion[i] + data.velocity[i]);
  return work;
}

}  // namespace dashpot
