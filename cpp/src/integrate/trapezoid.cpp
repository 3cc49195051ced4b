#include "dashpot/integrate/trapezoid.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/integrate/turning_substeps.hpp"
#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/springs_and_dampers.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot {

void Trapezoid::finish_last_step(const mjData_* d, const StepView& step, bool whole,
                                 TreeMotion& motion, Rows& rows, RowData& data,
                                 EnergyLedger& ledger) {
  const double length = step.length;
  const Memory& memory = step.memory;
  added_.clear();
  fastest_turn_ = 0.0;
  if (!memory.held_motion().length) return;
  const Trees& trees = motion.trees();
  find_light_trees(d, step, motion);
  couple_trees(rows, motion);
  drives_.start(model_, d, motion.start_velocity());
  if (std::all_of(first_.begin(), first_.end(), [](int first) { return first < 0; })) return;
  find_left_correctors(memory, motion);
  find_potential_forces(d, motion);
  drives_.find(model_, d, memory.held_motion(), trees, left_corrector_);
  recall_equalities(step, rows, trees);
  translations_.find(model_, d, rows, trees, first_);
  holding_rows_.find_at_start(step, rows, data, trees);
  if (find_scales(d, length, whole, memory, motion)) {
    if (!whole) correct_speeds();
    book_corrector(ledger);
    add_corrector(trees, data);
    count_followed_changes(trees);
    stop_fast_turns(length, rows);
  }
  load_gravity(d, motion, data);
}

void Trapezoid::couple_trees(const Rows& rows, const TreeMotion& motion) {
  const Trees& trees = motion.trees();
  find_coupled_trees(rows, static_cast<int>(trees.tree.size()), first_);
  coupled_.assign(first_.size(), {});
  for (int first : first_)
    if (first >= 0) coupled_[first].by_equalities = true;
  for (size_t i = 0; i < first_.size(); ++i)
    if (first_[i] < 0 && motion.linked()[i] && !trees.is_soft(i)) first_[i] = i;
}

void Trapezoid::find_left_correctors(const Memory& memory, const TreeMotion& motion) {
  const HeldMotion before = memory.held_motion();
  left_corrector_.assign(first_.size(), 0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = motion.trees().tree[index];
    const auto begin = motion.start_velocity().begin() + t.dof_begin;
    left_corrector_[index] =
        first_[index] >= 0 && before.length[index] > 0.0 &&
        std::equal(begin, begin + t.dof_count, memory.end_velocity() + t.dof_begin);
  }
}

void Trapezoid::find_potential_forces(const mjData_* d, const TreeMotion& motion) {
  potential_.resize(motion.start_velocity().size());
  joint_spring_.resize(potential_.size());
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!holds(index) || host::is_free_body(model_, index)) continue;
    const Tree& t = motion.trees().tree[index];
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
      potential_[i] = host::potential_force(model_, d, i);
      joint_spring_[i] = host::joint_spring_force(model_, d, i);
    }
  }
}

double Trapezoid::changing_potential(const mjData_* d, bool gravity_ahead, int dof) const {
  const double held = gravity_ahead ? host::spring_force(d, dof) : potential_[dof];
  return held - joint_spring_[dof];
}

void Trapezoid::recall_equalities(const StepView& step, const Rows& rows, const Trees& trees) {
  wrench_.assign(trees.coordinates, 0.0);
  for (int index : rows.equality) {
    const RowGroup& c = rows.group[index];
    const double* equality = step.memory.equality(step.constraints[c.input].memory);
    scatter(rows, c, equality, wrench_.data());
    coupled_[first_[c.tree[0]]].turning_work += equality[1];
  }
}

bool Trapezoid::find_scales(const mjData_* d, double length, bool whole, const Memory& memory,
                            TreeMotion& motion) {
  do {
    for (CoupledEnergy& coupled : coupled_) coupled = coupled.anew();
    find_corrector(d, memory, motion);
    if (std::none_of(coupled_.begin(), coupled_.end(),
                     [](const CoupledEnergy& c) { return c.by_equalities || c.left_corrector; }))
      return false;
    const bool any_held = std::any_of(coupled_.begin(), coupled_.end(), [](const CoupledEnergy& c) {
      return c.by_equalities || c.held;
    });
    if (any_held) {
      find_energies(d, length, memory, motion);
      find_springs(d, memory, motion);
    }
    for (CoupledEnergy& coupled : coupled_)
      if (coupled.left_corrector)
        coupled.scale =
            whole || !(coupled.held || coupled.by_equalities) ? 1.0 : coupled.find_scale();
  } while (give_up_drives(coupled_));
  return true;
}

void Trapezoid::find_corrector(const mjData_* d, const Memory& memory, TreeMotion& motion) {
  const HeldMotion before = memory.held_motion();
  const Trees& trees = motion.trees();
  const std::vector<double>& velocity = motion.start_velocity();
  corrector_.assign(trees.coordinates, 0.0);
  force_.resize(trees.coordinates);
  generalized_.assign(velocity.size(), 0.0);
  holding_rows_.forget_borne();
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = trees.tree[index];
    if (!left_corrector_[index]) continue;
    CoupledEnergy& coupled = coupled_[first_[index]];
    coupled.left_corrector = true;
    coupled.held = coupled.held || before.held[index] != 0.0;
    coupled.wanted += before.energy[index];
    const bool flies = !coupled.by_equalities && before.held[index] == 0.0;
    double* force = force_.data() + t.begin;
    for (int i = 0; i < t.count; ++i)
      force[i] = 0.5 * (wrench_[t.begin + i] + before.other_force[t.begin + i]);
    for (int i = 0; i < t.dof_count && !host::is_free_body(model_, index); ++i) {
      const int dof = t.dof_begin + i;
      const double turning = potential_[dof] - host::positional_force(d, dof);
      const double potential = changing_potential(d, before.gravity_ahead[index] != 0.0, dof);
      force[i] += 0.5 * (potential - turning);
      coupled.wanted += 0.5 * potential * before.displacement[dof];
      if (!coupled.follows_drives) continue;
      const double change = 0.5 * drives_.followed_change(dof);
      force[i] += change;
      if (!flies) coupled.driven += change * before.displacement[dof];
      coupled.drives_change = coupled.drives_change || change != 0.0;
    }
    double* half = corrector_.data() + t.begin;
    motion.invert_inertia(d, index);  // no row has asked for that of a tree that has come free
    respond(d, trees, index, before, force, half);
    for (int i = 0; i < t.count; ++i)
      half[i] = before.length[index] * (half[i] - before.acceleration[t.begin + i]);
    if (!coupled.by_equalities) holding_rows_.bar(trees, index, half, 1.0);
    motion.to_generalized(index, half, generalized_.data() + t.dof_begin);
    if (differs_in_damping(trees, index, before)) {
      const auto form = [&](const std::vector<double>& v) {
        return host::damping_form(model_, d, trees, t, v.data(), generalized_.data());
      };
      coupled.damped_beside += (before.implicit_time[index] - t.implicit_time) *
                               (form(velocity) + 0.5 * form(generalized_));
    }
    if (flies && coupled.drives_change)
      coupled.driven += work_of_drives(d, trees, index, before, velocity);
  }
}

void Trapezoid::find_energies(const mjData_* d, double length, const Memory& memory,
                              const TreeMotion& motion) {
  const std::vector<double>& velocity = motion.start_velocity();
  momentum_.resize(velocity.size());
  momentum_of_half_.resize(velocity.size());
  host::times_inertia(model_, d, velocity.data(), momentum_.data());
  host::times_inertia(model_, d, generalized_.data(), momentum_of_half_.data());
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (first_[index] < 0) continue;
    const Tree& t = motion.trees().tree[index];
    CoupledEnergy& coupled = coupled_[first_[index]];
    double kinetic = 0.0;
    for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
      kinetic += 0.5 * velocity[i] * momentum_[i];
      coupled.linear += velocity[i] * momentum_of_half_[i];
      coupled.square += 0.5 * generalized_[i] * momentum_of_half_[i];
    }
    if (left_corrector_[index]) {
      const Trees& trees = motion.trees();
      const double before = memory.held_motion().implicit_time[index];
      const double implicit = t.damped ? (before > 0.0 ? before : t.implicit_time) : length;
      const auto damped = [&](const double* v) {
        return implicit * host::damping_form(model_, d, trees, t, v, generalized_.data());
      };
      coupled.damped_linear += damped(velocity.data());
      coupled.damped_square += 0.5 * damped(generalized_.data());
    }
    coupled.kinetic += kinetic;
    if (!left_corrector_[index] || host::is_free_body(model_, index)) coupled.wanted += kinetic;
  }
  find_common_momenta(d, motion);
  for (CoupledEnergy& coupled : coupled_) coupled.wanted += coupled.turning_work + coupled.driven;
}

void Trapezoid::find_common_momenta(const mjData_* d, const TreeMotion& motion) {
  for (int direction = 0; direction < kDirections; ++direction) {
    if (!translations_.any(direction)) continue;
    translation_.motion.resize(momentum_.size());
    translation_.momentum.resize(momentum_.size());
    for (int index = 0; index < motion.tree_count(); ++index) {
      const Tree& t = motion.trees().tree[index];
      motion.to_generalized(index, translations_.motion(direction).data() + t.begin,
                            translation_.motion.data() + t.dof_begin);
    }
    host::times_inertia(model_, d, translation_.motion.data(), translation_.momentum.data());
    for (int index = 0; index < motion.tree_count(); ++index) {
      if (first_[index] < 0) continue;
      const Tree& t = motion.trees().tree[index];
      CommonMomentum& common = coupled_[first_[index]].common[direction];
      for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) {
        common.mass += translation_.motion[i] * translation_.momentum[i];
        common.of_velocity += translation_.motion[i] * momentum_[i];
        common.of_half += translation_.motion[i] * momentum_of_half_[i];
      }
    }
  }
}

void Trapezoid::correct_speeds() {
  for (size_t first = 0; first < coupled_.size(); ++first) {
    CoupledEnergy& coupled = coupled_[first];
    if (!coupled.left_corrector) continue;
    const bool on_ground = !coupled.by_equalities || translations_.count(first) < kDirections;
    if (coupled.scale == 0.0) coupled.correct_speed(on_ground);
    coupled.turns = coupled.scale != 0.0 || !coupled.by_equalities;
    if (coupled.by_equalities && coupled.turns && coupled.brake == 0.0)
      coupled.lost = coupled.wanted - coupled.energy_with(coupled.scale);
  }
}

void Trapezoid::book_corrector(EnergyLedger& ledger) const {
  for (const CoupledEnergy& coupled : coupled_) {
    if (!coupled.left_corrector) continue;
    // What damping takes of it is in the work of the next step, which starts from before it.
    ledger.work += coupled.driven;
    ledger.dissipated_damping += coupled.damped_beside;
    if (coupled.turns)
      ledger.dissipated_constraint += coupled.lost - coupled.turning_work;
    else
      ledger.dissipated_constraint += coupled.inside() * coupled.brake * (2.0 - coupled.brake);
  }
}

void Trapezoid::add_corrector(const Trees& trees, RowData& data) {
  added_.assign(trees.coordinates, 0.0);
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (first_[index] < 0) continue;
    const CoupledEnergy& coupled = coupled_[first_[index]];
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) {
      double inside = data.velocity[i] + coupled.scale * corrector_[i];
      for (int direction = 0; direction < kDirections; ++direction)
        if (translations_.any(direction))
          inside -= translations_.motion(direction)[i] *
                    coupled.common[direction].velocity(coupled.scale);
      added_[i] = coupled.scale * corrector_[i] - coupled.brake * inside;
      data.velocity[i] += added_[i];
    }
  }
}

void Trapezoid::count_followed_changes(const Trees& trees) {
  for (size_t index = 0; index < trees.tree.size(); ++index) {
    if (!left_corrector_[index] || !coupled_[first_[index]].follows_drives) continue;
    drives_.count_followed(trees.tree[index], coupled_[first_[index]].scale);
  }
}

void Trapezoid::add_load(const std::vector<double>& load, int tree, const Trees& trees,
                         RowData& data) {
  const Tree& t = trees.tree[tree];
  force_.resize(trees.coordinates);
  std::fill_n(force_.begin() + t.begin, t.count, 0.0);
  std::copy_n(load.begin() + t.dof_begin, t.dof_count, force_.begin() + t.begin);
  load_response_.assign(t.count, 0.0);
  add_response(trees, tree, force_.data() + t.begin, load_response_.data());
  for (int i = 0; i < t.dof_count; ++i) {
    data.added_acceleration[t.begin + i] += load_response_[i];
    data.smooth_acceleration[t.begin + i] += load_response_[i];
  }
}

void Trapezoid::add_borne(std::vector<double>& impulse) {
  if (added_.empty()) return;
  for (size_t index = 0; index < first_.size(); ++index)
    if (left_corrector_[index])
      holding_rows_.add_borne(static_cast<int>(index), coupled_[first_[index]].scale, impulse);
}

// Rows turn by about dJ/dt xi H in the speed sqrt(2 w E) that the kinetic energy E could give them,
// without that of common translations, which move no row. Of rows that mocap bodies drive that
// speed says nothing: they have the energy of the drive.
void Trapezoid::stop_fast_turns(double length, Rows& rows) {
  for (int index : rows.equality) {
    const RowGroup& c = rows.group[index];
    CoupledEnergy& coupled = coupled_[first_[c.tree[0]]];
    const double w = rows.inverse_mass[c.row];
    const double speed = std::sqrt(2.0 * w * std::max(0.0, coupled.inside()));
    const double turn = speed > 0.0 ? length * std::abs(turning_rate(rows, c)) / speed : 0.0;
    const bool is_driven = c.ground == kSurfaceCoordinate;
    // Of a row across the plane of a linkage rounding is all that moves and turns.
    const bool moves = w > kDirection * kDirection * rows.typical_inverse_mass[c.row];
    if (moves && !is_driven) fastest_turn_ = std::max(fastest_turn_, turn);
    if (!is_driven && turn > kSubstepTurn) coupled.turns = false;
  }
  for (int index : rows.equality)
    if (const RowGroup& c = rows.group[index]; !coupled_[first_[c.tree[0]]].turns)
      stop_turning(rows, c);
}

}  // namespace dashpot
