// What tells how much of the Verlet corrector of a step springs and servos bring.

#include <algorithm>

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot {

void Trapezoid::find_springs(const mjData_* d, const Memory& memory, const TreeMotion& motion) {
  const HeldMotion before = memory.held_motion();
  const int trees = motion.tree_count();
  const auto change_of = [&](const CoupledEnergy& coupled, int tree, int dof) {
    const double change =
        changing_potential(d, before.gravity_ahead[tree] != 0.0, dof) - before.potential[dof];
    return coupled.follows_drives ? change + drives_.servo_change(dof) : change;
  };
  for (int index = 0; index < trees; ++index) {
    if (!left_corrector_[index]) continue;
    const Tree& t = motion.trees().tree[index];
    CoupledEnergy& coupled = coupled_[first_[index]];
    if (host::is_free_body(model_, index)) continue;
    double work = 0.0;
    for (int dof = t.dof_begin; dof < t.dof_begin + t.dof_count; ++dof)
      work += change_of(coupled, index, dof) * before.displacement[dof];
    coupled.restoring -= work * before.length[index] * before.length[index];
  }
  const auto asks = [&](int index) {
    return left_corrector_[index] && coupled_[first_[index]].restoring > 0.0;
  };
  int first = 0;
  while (first < trees && !asks(first)) ++first;
  if (first == trees) return;
  springs_.rest.assign(generalized_.size(), 0.0);
  springs_.way.assign(generalized_.size(), 0.0);
  for (int index = first; index < trees; ++index) {
    if (!asks(index)) continue;
    const Tree& t = motion.trees().tree[index];
    const CoupledEnergy& coupled = coupled_[first_[index]];
    std::copy_n(before.displacement + t.dof_begin, t.dof_count, springs_.way.begin() + t.dof_begin);
    std::copy_n(generalized_.begin() + t.dof_begin, t.dof_count,
                springs_.rest.begin() + t.dof_begin);
    if (host::is_free_body(model_, index)) continue;
    double* force = force_.data() + t.begin;
    for (int i = 0; i < t.dof_count; ++i)
      force[i] = 0.5 * before.length[index] * change_of(coupled, index, t.dof_begin + i);
    springs_.half.assign(t.count, 0.0);
    add_response(motion.trees(), index, force, springs_.half.data());
    if (!coupled.by_equalities) holding_rows_.bar(motion.trees(), index, springs_.half.data(), 0.0);
    for (int i = 0; i < t.dof_count; ++i) springs_.rest[t.dof_begin + i] -= springs_.half[i];
  }
  momentum_of_half_.resize(springs_.rest.size());
  const auto add_squares = [&](const std::vector<double>& x, double CoupledEnergy::*sum) {
    host::times_inertia(model_, d, x.data(), momentum_of_half_.data());
    for (int index = first; index < trees; ++index) {
      if (!asks(index)) continue;
      const Tree& t = motion.trees().tree[index];
      for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
        coupled_[first_[index]].*sum += x[i] * momentum_of_half_[i];
    }
  };
  add_squares(springs_.way, &CoupledEnergy::way);
  add_squares(springs_.rest, &CoupledEnergy::rest);
}

}  // namespace dashpot
