#include "dashpot/trapezoid.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_effective_inertia.hpp"
#include "dashpot/mujoco_forces.hpp"
#include "dashpot/mujoco_state.hpp"
#include "dashpot/mujoco_trees.hpp"
#include "dashpot/runge_kutta.hpp"

namespace dashpot {

namespace {

// s differs from 1 by some H times the rate of the motion where the step resolves it.
constexpr double kScaleRange = 0.5;
// Part of the kinetic energy that s at an end of its range may leave: at turning points energies do
// not determine s, and an impact leaves far more.
constexpr double kResidual = 1e-6;
// Second half, as part of the velocity, up to which steps resolve how a motion turns that only
// contacts and limits hold. Beyond, it throws light links about, faster from hit to hit.
constexpr double kLargestHalf = 0.1;
// Part of the velocity, most that may be added where no s conserves energy: impacts lose or gain so
// much by chance. Motion that loses more is one that steps do not resolve, and may gain it in turn.
constexpr double kBoost = 0.03;
// Of the parts of a rate that cancel.
constexpr double kRounding = 1e-9;
// rad, most that rows may turn in a step: the velocities at its end, which lack the second half,
// have an energy that is off by half the square of it.
constexpr double kTurn = 0.1;

// What two changes, one after the other, have in common: the smaller if both have one sign.
double lasting_part(double before, double now) {
  if (before * now <= 0.0) return 0.0;
  return std::abs(before) < std::abs(now) ? before : now;
}

// Whether the smooth motion of a tree already knows of its forces at the end of a step.
bool moves_accurately(const mjModel_* model, int tree) {
  return host::is_free_body(model, tree) || host::is_runge_kutta(model);
}

}  // namespace

Trapezoid::Coupled Trapezoid::Coupled::anew() const {
  Coupled same;
  same.turning_work = turning_work;
  same.by_equalities = by_equalities;
  same.follows_drives = follows_drives;
  return same;
}

// The root nearest to 1 of kinetic + linear s + square s^2 = wanted, the damped ones beside, at
// turning points of the motion the end of the range that comes as near; 0 if there is none.
double Trapezoid::Coupled::find_scale() const {
  if (!by_equalities && square > kLargestHalf * kLargestHalf * kinetic) return 0.0;
  const double first = linear + damped_linear, second = square + damped_square;
  const double root = std::sqrt(first * first - 4.0 * second * (kinetic - wanted));
  const double sum = first + std::copysign(root, first);  // without cancellation
  double nearest = 0.0;
  for (double s : {-0.5 * sum / second, -2.0 * (kinetic - wanted) / sum})
    if (std::abs(s - 1.0) < std::abs(nearest - 1.0)) nearest = s;
  const double s = std::clamp(nearest, 1.0 - kScaleRange, 1.0 + kScaleRange);
  const double residual = std::abs(kinetic + s * (first + s * second) - wanted);
  return residual <= kResidual * kinetic ? s : 0.0;
}

// The part of the velocity to take away for the energy to be what it ought to.
double Trapezoid::Coupled::find_brake() const {
  if (kinetic <= 0.0) return 0.0;
  const double excess = 1.0 - std::sqrt(std::max(0.0, wanted) / kinetic);
  return excess < -kBoost ? 0.0 : excess;
}

void Trapezoid::find_coupled_trees(const Rows& rows, int trees) {
  first_.assign(trees, -1);
  coupled_.assign(trees, {});
  for (bool changed = true; changed;) {
    changed = false;
    for (const RowGroup& c : rows.group) {
      if (c.kind != RowKind::kBilateral) continue;
      int first = c.tree[0];
      for (int tree : c.tree)
        if (tree >= 0 && first_[tree] >= 0) first = std::min(first, first_[tree]);
      for (int tree : c.tree) {
        if (tree < 0 || first_[tree] == first) continue;
        first_[tree] = first;
        changed = true;
      }
    }
  }
  for (int first : first_)
    if (first >= 0) coupled_[first].by_equalities = true;
}

void Trapezoid::find_held_trees(const mjModel_* model, const Rows& rows) {
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact && c.kind != RowKind::kUnilateral) continue;
    for (int tree : c.tree)
      if (tree >= 0 && first_[tree] < 0 && !moves_accurately(model, tree)) first_[tree] = tree;
  }
}

void Trapezoid::find_freed_trees(const mjModel_* model, const HeldMotion& before) {
  for (size_t index = 0; index < first_.size(); ++index)
    if (first_[index] < 0 && before.length[index] > 0.0 && !moves_accurately(model, index))
      first_[index] = index;
}

void Trapezoid::finish_last_step(const mjModel_* model, const mjData_* d, double length,
                                 const Memory& memory,
                                 const std::vector<ConstraintInput>& constraints,
                                 const std::vector<Match>& matches, TreeMotion& motion, Rows& rows,
                                 RowData& data, EnergyLedger& ledger) {
  added_.clear();
  load_.clear();
  const HeldMotion before = memory.held_motion();
  if (!before.length) return;
  const Trees& trees = motion.trees();
  find_coupled_trees(rows, motion.tree_count());
  find_held_trees(model, rows);
  find_freed_trees(model, before);
  host::drives(model, d, motion.start_velocity(), drive_);
  drive_change_.assign(drive_.size(), 0.0);
  if (std::all_of(first_.begin(), first_.end(), [](int first) { return first < 0; })) return;
  find_potential_forces(model, d, trees);
  wrench_.assign(trees.coordinates, 0.0);
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kBilateral) continue;
    const double* equality = memory.equality(constraints[c.input].memory);
    scatter(rows, c, equality, wrench_.data());
    coupled_[first_[c.tree[0]]].turning_work += equality[1];
  }
  holding_rows_.find_at_start(rows, constraints, matches, memory, trees, length);
  do {
    for (Coupled& coupled : coupled_) coupled = coupled.anew();
    find_second_half(model, d, memory, motion);
    if (std::none_of(coupled_.begin(), coupled_.end(),
                     [](const Coupled& c) { return c.by_equalities || c.left_half; }))
      return;
    find_energies(model, d, length, motion);
  } while (find_scales());
  for (size_t first = 0; first < coupled_.size(); ++first) {
    Coupled& coupled = coupled_[first];
    if (!coupled.left_half) continue;
    coupled.turns = coupled.scale != 0.0 || !coupled.by_equalities;
    if (coupled.scale == 0.0 &&
        (!coupled.by_equalities || are_on_ground(model, d, rows, trees, first)))
      coupled.brake = coupled.find_brake();
    if (coupled.by_equalities) coupled.brake = std::max(0.0, coupled.brake);
    // What damping takes of it is in the work of the next step, which starts from before it.
    ledger.work += coupled.driven;
    if (coupled.turns)
      ledger.dissipated_constraint -= coupled.turning_work;
    else
      ledger.dissipated_constraint += coupled.kinetic * coupled.brake * (2.0 - coupled.brake);
  }
  added_.assign(trees.coordinates, 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (first_[index] < 0) continue;
    const double scale = coupled_[first_[index]].scale;
    const double brake = coupled_[first_[index]].brake;
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) {
      added_[i] = scale * second_half_[i] - brake * data.velocity[i];
      data.velocity[i] += added_[i];
    }
  }
  load_drives(length, memory, trees, data);
  stop_fast_turns(length, rows);
}

bool Trapezoid::are_on_ground(const mjModel_* model, const mjData_* d, const Rows& rows,
                              const Trees& trees, int first) {
  for (int axis = 0; axis < 3; ++axis) {
    force_.assign(trees.coordinates, 0.0);
    for (size_t index = 0; index < first_.size(); ++index)
      if (first_[index] == first &&
          !host::add_translation(model, d, trees, index, axis, force_.data()))
        return true;
    for (const RowGroup& c : rows.group) {
      if (c.kind != RowKind::kBilateral || first_[c.tree[0]] != first) continue;
      double rate = 0.0, most = 0.0;
      for (int k = 0; k < c.columns[0] + c.columns[1]; ++k) {
        const double part = rows.value[c.value + k] * force_[rows.column[c.column + k]];
        rate += part;
        most = std::max(most, std::abs(part));
      }
      if (std::abs(rate) > kRounding * most) return true;
    }
  }
  return false;
}

void Trapezoid::find_potential_forces(const mjModel_* model, const mjData_* d, const Trees& trees) {
  potential_.resize(drive_.size());
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!holds(index) || moves_accurately(model, index)) continue;
    const Tree& t = trees.tree[index];
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i)
      potential_[i] = host::potential_force(model, d, i);
  }
}

void Trapezoid::load_drives(double length, const Memory& memory, const Trees& trees,
                            RowData& data) {
  const HeldMotion before = memory.held_motion();
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_half_[index]) continue;
    const Coupled& coupled = coupled_[first_[index]];
    if (coupled.follows_drives || coupled.by_equalities) continue;
    const Tree& t = trees.tree[index];
    if (load_.empty()) load_.assign(drive_.size(), 0.0);
    const double ahead = 0.5 * std::min(1.0, length / before.length[index]);
    std::fill_n(force_.begin() + t.begin, t.count, 0.0);
    for (int i = 0; i < t.dof_count; ++i) {
      const int dof = t.dof_begin + i;
      load_[dof] = ahead * lasting_part(before.drive_change[dof], drive_change_[dof]);
      force_[t.begin + i] = load_[dof];
    }
    double* added = data.added_acceleration.data() + t.begin;
    add_response(trees, index, force_.data() + t.begin, added);
    for (int i = 0; i < t.dof_count; ++i) data.smooth_acceleration[t.begin + i] += added[i];
  }
}

void Trapezoid::find_second_half(const mjModel_* model, const mjData_* d, const Memory& memory,
                                 TreeMotion& motion) {
  const HeldMotion before = memory.held_motion();
  const double* end_velocity = memory.end_velocity();
  const double* leads = memory.leading_length();
  const Trees& trees = motion.trees();
  const std::vector<double>& velocity = motion.start_velocity();
  second_half_.assign(trees.coordinates, 0.0);
  force_.resize(trees.coordinates);
  generalized_.assign(velocity.size(), 0.0);
  left_half_.assign(trees.tree.size(), 0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = trees.tree[index];
    const auto begin = velocity.begin() + t.dof_begin;
    left_half_[index] = first_[index] >= 0 && before.length[index] > 0.0 &&
                        std::equal(begin, begin + t.dof_count, end_velocity + t.dof_begin);
    if (!left_half_[index]) continue;
    Coupled& coupled = coupled_[first_[index]];
    coupled.left_half = true;
    coupled.wanted += before.energy[index];
    double* force = force_.data() + t.begin;
    const double weight = before.weight[index];
    for (int i = 0; i < t.count; ++i)
      force[i] = weight * (wrench_[t.begin + i] + before.other_force[t.begin + i]);
    for (int i = 0; i < t.dof_count && !moves_accurately(model, index); ++i) {
      const int dof = t.dof_begin + i;
      const double potential = potential_[dof];
      const double turning = potential - host::positional_force(d, dof);
      force[i] += weight * potential - 0.5 * turning;
      coupled.wanted += weight * potential * before.displacement[dof] +
                        0.5 * leads[index] * velocity[dof] * turning;
      drive_change_[dof] = drive_[dof] - before.drive[dof];
      if (!coupled.follows_drives) continue;
      const double change = weight * drive_change_[dof];
      force[i] += change;
      coupled.driven += change * before.displacement[dof];
      coupled.drives_change = coupled.drives_change || change != 0.0;
    }
    double* half = second_half_.data() + t.begin;
    motion.invert_inertia(index);  // no row has asked for that of a tree that has come free
    add_response(trees, index, force, half);
    for (int i = 0; i < t.count; ++i)
      half[i] = before.length[index] * (half[i] - before.acceleration[t.begin + i]);
    if (!coupled.by_equalities) holding_rows_.bar(trees, index, half);
    motion.to_generalized(index, half, generalized_.data() + t.dof_begin);
  }
}

void Trapezoid::find_energies(const mjModel_* model, const mjData_* d, double length,
                              const TreeMotion& motion) {
  const std::vector<double>& velocity = motion.start_velocity();
  momentum_.resize(velocity.size());
  momentum_of_half_.resize(velocity.size());
  host::times_inertia(model, d, velocity.data(), momentum_.data());
  host::times_inertia(model, d, generalized_.data(), momentum_of_half_.data());
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (first_[index] < 0) continue;
    const Tree& t = motion.trees().tree[index];
    Coupled& coupled = coupled_[first_[index]];
    double kinetic = 0.0;
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
      kinetic += 0.5 * velocity[i] * momentum_[i];
      coupled.linear += velocity[i] * momentum_of_half_[i];
      coupled.square += 0.5 * generalized_[i] * momentum_of_half_[i];
    }
    if (left_half_[index]) {
      const Trees& trees = motion.trees();
      const double implicit = t.damped ? trees.implicit_time : length;
      const auto damped = [&](const double* v) {
        return implicit * host::damping_form(model, d, trees, t, v, generalized_.data());
      };
      coupled.damped_linear += damped(velocity.data());
      coupled.damped_square += 0.5 * damped(generalized_.data());
    }
    coupled.kinetic += kinetic;
    if (!left_half_[index] || moves_accurately(model, index)) coupled.wanted += kinetic;
  }
  for (Coupled& coupled : coupled_) coupled.wanted += coupled.turning_work + coupled.driven;
}

bool Trapezoid::find_scales() {
  bool again = false;
  for (Coupled& coupled : coupled_) {
    if (!coupled.left_half) continue;
    coupled.scale = coupled.find_scale();
    if (coupled.scale != 0.0 || !coupled.follows_drives || !coupled.drives_change) continue;
    coupled.follows_drives = false;
    again = true;
  }
  return again;
}

// Rows turn by about dJ/dt xi H in the speed sqrt(2 w E) that the kinetic energy E could give them.
// Where mocap bodies drive them energy is not conserved.
void Trapezoid::stop_fast_turns(double length, Rows& rows) {
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kBilateral) continue;
    Coupled& coupled = coupled_[first_[c.tree[0]]];
    const double turned = length * turning_rate(rows, c);
    const double speed_square = 2.0 * rows.inverse_mass[c.row] * coupled.kinetic;
    const bool driven = c.ground == kSurfaceCoordinate;
    if (driven || turned * turned > kTurn * kTurn * speed_square) coupled.turns = false;
  }
  for (const RowGroup& c : rows.group)
    if (c.kind == RowKind::kBilateral && !coupled_[first_[c.tree[0]]].turns) stop_turning(rows, c);
}

void Trapezoid::keep_equalities(double length, const std::vector<ConstraintInput>& constraints,
                                const Rows& rows, const RowData& data, Memory& memory,
                                EnergyLedger& ledger) {
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kBilateral) continue;
    double* equality = memory.equality(constraints[c.input].memory);
    equality[0] = data.total_impulse[c.row] / length;
    equality[1] = turning_rate(rows, c) * data.force_moment[i];
    scatter(rows, c, equality, wrench_.data());
    ledger.dissipated_constraint += equality[1];
  }
}

bool Trapezoid::keep_lengths(const EndOfStep& end, HeldMotion& now) const {
  bool any = false;
  for (size_t index = 0; index < end.held.size(); ++index) {
    const bool leaves =
        end.leaves_half && end.held[index] && first_[index] >= 0 && coupled_[first_[index]].turns;
    now.length[index] = leaves ? end.length : 0.0;
    any = any || leaves;
  }
  return any;
}

// `leads` (s): how far positions led velocities at the start of the step.
void Trapezoid::keep_tree(const mjModel_* model, const mjData_* d, const EndOfStep& end, int tree,
                          double leads, const TreeMotion& motion, const RowData& data,
                          HeldMotion& now) {
  const Tree& t = motion.trees().tree[tree];
  const std::vector<double>& displacement = end.displacement;
  std::copy_n(displacement.begin() + t.dof_begin, t.dof_count, now.displacement + t.dof_begin);
  std::copy_n(drive_.begin() + t.dof_begin, t.dof_count, now.drive + t.dof_begin);
  std::copy_n(drive_change_.begin() + t.dof_begin, t.dof_count, now.drive_change + t.dof_begin);
  double* acceleration = now.acceleration + t.begin;
  double* force = now.other_force + t.begin;
  double& energy = now.energy[tree];
  double& weight = now.weight[tree];
  std::fill_n(acceleration, t.count, 0.0);
  energy = 0.0;
  weight = 0.5;
  if (moves_accurately(model, tree)) {
    for (int i = 0; i < t.count; ++i) force[i] = -wrench_[t.begin + i];
    return;
  }
  const double fell_back = end.fell_back[tree], back = std::min(fell_back, end.length);
  weight = (end.length - back) / (2.0 * end.length + leads - back);
  for (int i = 0; i < t.count; ++i) force[i] = data.coordinate_impulse[t.begin + i] / end.length;
  const double* velocity = host::velocity(d);
  double* seen = generalized_.data() + t.dof_begin;
  for (int i = 0; i < t.dof_count; ++i) {
    const int dof = t.dof_begin + i;
    const double potential = potential_[dof];
    const double turning = potential - host::positional_force(d, dof);
    force[i] += host::smooth_force(d, dof) + turning;
    energy += 0.5 * velocity[dof] * momentum_[dof] +
              (turning - weight * potential) * displacement[dof] -
              0.5 * fell_back * motion.start_velocity()[dof] * turning;
    seen[i] = weight * force[i] - 0.5 * turning;
    force[i] -= wrench_[t.begin + i] + potential;
  }
  add_response(motion.trees(), tree, seen, acceleration);
}

void Trapezoid::keep(const mjModel_* model, const mjData_* d, const EndOfStep& end,
                     const std::vector<ConstraintInput>& constraints, const TreeMotion& motion,
                     const Rows& rows, const RowData& data, Memory& memory, EnergyLedger& ledger) {
  HeldMotion now = memory.held_motion();
  if (!now.length) return;
  wrench_.assign(motion.trees().coordinates, 0.0);
  keep_equalities(end.length, constraints, rows, data, memory, ledger);
  if (!keep_lengths(end, now)) return;
  generalized_.resize(end.displacement.size());
  momentum_.resize(end.displacement.size());
  host::times_inertia(model, d, host::velocity(d), momentum_.data());
  const double* leads = memory.leading_length();
  for (int tree = 0; tree < motion.tree_count(); ++tree)
    if (now.length[tree] > 0.0) keep_tree(model, d, end, tree, leads[tree], motion, data, now);
}

}  // namespace dashpot
