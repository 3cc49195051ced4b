// What a step leaves over for the next one, which finishes it.

#include <algorithm>

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot {

void Trapezoid::keep_equalities(const EndOfStep& end, Memory& memory, EnergyLedger& ledger) {
  const Rows& rows = end.rows;
  for (int i : rows.equality) {
    const RowGroup& c = rows.group[i];
    double* equality = memory.equality(end.constraints[c.input].memory);
    equality[0] = end.data.total_impulse[c.row] / end.length;
    equality[1] = turning_rate(rows, c) * end.data.force_moment[i];
    scatter(rows, c, equality, wrench_.data());
    ledger.dissipated_constraint += equality[1];
  }
}

bool Trapezoid::keep_lengths(const EndOfStep& end, const TreeMotion& motion,
                             HeldMotion& now) const {
  bool any = false;
  for (size_t index = 0; index < end.held.size(); ++index) {
    now.length[index] = 0.0;
    now.held[index] = end.held[index];
    if (!end.leaves_corrector || first_[index] < 0) continue;
    if (!end.held[index] && !motion.linked()[index]) continue;
    const CoupledEnergy& coupled = coupled_[first_[index]];
    if (!coupled.turns) continue;
    now.length[index] = end.length;
    any = true;
  }
  return any;
}

void Trapezoid::keep_tree(const mjData_* d, const EndOfStep& end, int tree,
                          const TreeMotion& motion, HeldMotion& now) {
  const Tree& t = motion.trees().tree[tree];
  const std::vector<double>& displacement = end.displacement;
  std::copy_n(displacement.begin() + t.dof_begin, t.dof_count, now.displacement + t.dof_begin);
  drives_.keep(model_, motion.trees(), tree, motion.start_velocity().data(), host::velocity(d),
               now);
  double* acceleration = now.acceleration + t.begin;
  double* force = now.other_force + t.begin;
  double& energy = now.energy[tree];
  std::fill_n(acceleration, t.count, 0.0);
  energy = 0.0;
  if (host::is_free_body(model_, tree)) {
    for (int i = 0; i < t.count; ++i) force[i] = -wrench_[t.begin + i];
    return;
  }
  const bool in_middle = light_[tree] != 0;
  now.gravity_ahead[tree] = in_middle;
  now.implicit_time[tree] = t.damped ? t.implicit_time : 0.0;
  for (int i = 0; i < t.count; ++i)
    force[i] =
        (end.data.coordinate_impulse[t.begin + i] + end.data.pulled[t.begin + i]) / end.length;
  const double* velocity = host::velocity(d);
  double* seen = generalized_.data() + t.dof_begin;
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    const double turning = potential_[dof] - host::positional_force(d, dof);
    const double potential = changing_potential(d, in_middle, dof);
    now.potential[dof] = potential;
    force[i] += host::smooth_force(d, dof) + turning + gravity_load_[dof];
    energy +=
        0.5 * velocity[dof] * momentum_[dof] + (turning - 0.5 * potential) * displacement[dof];
    seen[i] = 0.5 * (force[i] - turning);
    force[i] -= wrench_[t.begin + i] + potential;
  }
  add_response(motion.trees(), tree, seen, acceleration);
}

void Trapezoid::keep(const mjData_* d, const EndOfStep& end, const TreeMotion& motion,
                     Memory& memory, EnergyLedger& ledger) {
  HeldMotion now = memory.held_motion();
  if (!now.length) return;
  wrench_.assign(motion.trees().coordinates, 0.0);
  keep_equalities(end, memory, ledger);
  if (!keep_lengths(end, motion, now)) return;
  generalized_.resize(end.displacement.size());
  momentum_.resize(end.displacement.size());
  host::times_inertia(model_, d, host::velocity(d), momentum_.data());
  for (int tree = 0; tree < motion.tree_count(); ++tree)
    if (now.length[tree] > 0.0) keep_tree(d, end, tree, motion, now);
}

}  // namespace dashpot
