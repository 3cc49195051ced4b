// What springs, drives and the gravity of light parts do in the Verlet corrector of a step.

#include <algorithm>

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

// H^2 m g l / 2 I from which on gravity is that of the middle. From 1 on its Verlet corrector, a
// step late, feeds on itself; the others keep the energy of gravity better by it.
constexpr double kLightPart = 0.1;

}  // namespace

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

// The response of a tree to a force, or impulse, with the e D that its inertia had in the last step
// (model/effective_inertia.hpp); `response`: zeros before.
void Trapezoid::respond(const mjData_* d, const Trees& trees, int index, const HeldMotion& before,
                        const double* force, double* response) const {
  const Tree& t = trees.tree[index];
  if (!differs_in_damping(trees, index, before)) return add_response(trees, index, force, response);
  std::copy_n(force, t.dof_count, response);
  host::solve_damped(model_, d, trees, index, before.implicit_time[index], response);
}

bool Trapezoid::differs_in_damping(const Trees& trees, int index, const HeldMotion& before) {
  const Tree& t = trees.tree[index];
  const double implicit_time = before.implicit_time[index];
  return t.damped && !t.elastic && implicit_time > 0.0 && implicit_time != t.implicit_time;
}

// Work (J) of changes of drives, jumps too, on a tree in flight: the last part of its corrector.
double Trapezoid::work_of_drives(const mjData_* d, const Trees& trees, int index,
                                 const HeldMotion& before, const std::vector<double>& velocity) {
  const Tree& t = trees.tree[index];
  double* impulse = force_.data() + t.begin;
  for (int i = 0; i < t.dof_count; ++i)
    impulse[i] = 0.5 * before.length[index] * drives_.followed_change(t.dof_begin + i);
  load_response_.assign(t.count, 0.0);
  respond(d, trees, index, before, impulse, load_response_.data());
  double work = 0.0;
  for (int i = 0; i < t.dof_count; ++i)
    work += impulse[i] *
            (velocity[t.dof_begin + i] + generalized_[t.dof_begin + i] - 0.5 * load_response_[i]);
  return work;
}

// Gravity of light parts goes to the middle of a step with the contacts.
void Trapezoid::find_light_trees(const mjData_* d, const StepView& step, TreeMotion& motion) {
  const Trees& trees = motion.trees();
  light_.assign(trees.tree.size(), 0);
  frozen_at_.assign(trees.tree.size(), 0.0);
  for (const ContactInput& contact : step.contacts) {
    if (contact.ahead == 0.0) continue;
    for (int tree : contact.tree) {
      if (tree < 0) continue;
      double& at = frozen_at_[tree];
      at = at == 0.0 || at == contact.ahead ? contact.ahead : 0.5 * step.length;
    }
  }
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (frozen_at_[index] == 0.0 || host::is_free_body(model_, index)) continue;
    motion.invert_inertia(d, index);
    light_[index] = host::has_light_part(model_, d, trees, index, step.length, kLightPart);
  }
}

void Trapezoid::load_gravity(const mjData_* d, const TreeMotion& motion, RowData& data) {
  const Trees& trees = motion.trees();
  gravity_load_.assign(potential_.size(), 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!light_[index] || !holds(index)) continue;
    host::add_gravity_ahead(model_, d, index, frozen_at_[index], host::Gravity::kLessCompensation,
                            gravity_room_, gravity_load_.data());
    add_load(gravity_load_, index, trees, data);
  }
}

}  // namespace dashpot
