#include "energy_accounting.hpp"

#include <algorithm>

#include "dashpot/model/state.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 64;  // by a thread

}  // namespace

// Springs of what sleeps keep their energy.
void EnergyAccounting::open(const Memory& memory, const MarkedRows& sleeping) {
  ledger_ = memory.ledger();
  elastic_asleep_ = memory.energy(sleeping);
  ledger_.elastic -= elastic_asleep_;
}

void EnergyAccounting::close(Memory& memory) {
  ledger_.elastic += elastic_asleep_;
  memory.set_ledger(ledger_);
}

void EnergyAccounting::find_unpaid(const Memory& memory, const SolvedSubstep& substep,
                                   std::vector<double>& unpaid) const {
  unpaid.assign(substep.motion.tree_count(), 0.0);
  const double gained = memory.ledger().dissipated_by_contacts() - ledger_.dissipated_by_contacts();
  if (gained <= 0.0) return;
  const Rows& rows = substep.rows;
  double all = 0.0;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    const double energy = -substep.data.turning_work[i];
    if (energy <= 0.0 || rows.inverse_mass[c.row] == 0.0) continue;
    all += energy;
    for (int side = 0; side < 2; ++side)
      if (c.tree[side] >= 0)
        unpaid[c.tree[side]] +=
            energy * rows.tree_inverse_mass[c.row][side] / rows.inverse_mass[c.row];
  }
  if (all > gained)
    for (double& energy : unpaid) energy *= gained / all;
}

void EnergyAccounting::add_smooth_work(mjData_* d, const SolvedSubstep& substep, Team& team) {
  const mjModel_* const model = substep.model;
  const TreeMotion& motion = substep.motion;
  find_displacements(d, substep, team);
  ledger_.dissipated_recovery += host::potential_work(model, d, recovered_.data());
  smooth_work_.find(
      model, d, motion.trees(),
      {motion.start_velocity().data(), displacement_.data(), motion.smooth_acceleration().data(),
       &in_microsteps_, substep.data.braked.data()});
  ledger_.dissipated_damping -= smooth_work_.damping;
  ledger_.work += smooth_work_.applied + work_ahead_of_servos(substep);
  for (int index : substep.rows.on_surface) {
    const RowGroup& c = substep.rows.group[index];
    ledger_.work += surface_work(substep.rows, c, substep.data.total_impulse.data() + c.row);
  }
  for (double work : substep.data.acceleration_work) ledger_.work -= work;
}

// Trees that went as in the micro-steps went the integral of their velocity and what recovery
// displaced them; the change of kinetic energy of all others goes with their mean velocity.
void EnergyAccounting::find_displacements(const mjData_* d, const SolvedSubstep& substep,
                                          Team& team) {
  const TreeMotion& motion = substep.motion;
  const double* velocity = host::velocity(d);
  const std::vector<double>& start_velocity = motion.start_velocity();
  displacement_.resize(start_velocity.size());
  recovered_.assign(start_velocity.size(), 0.0);
  in_microsteps_.resize(motion.tree_count());
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    double* displacement = displacement_.data() + tree.dof_begin;
    for (int i = 0; i < tree.dof_count; ++i) {
      const int dof = tree.dof_begin + i;
      displacement[i] = 0.5 * substep.length * (start_velocity[dof] + velocity[dof]);
    }
    in_microsteps_[index] =
        motion.own() && (motion.linked()[index] || substep.on_trees.touched[index]);
    if (!in_microsteps_[index]) return;
    double* shift = recovered_.data() + tree.dof_begin;
    motion.to_generalized(index, substep.data.total_displacement.data() + tree.begin, displacement);
    motion.to_generalized(index, substep.recovery.data() + tree.begin, shift);
    for (int i = 0; i < tree.dof_count; ++i) displacement[i] -= shift[i];
  });
}

// Work of servos on free bodies by the force of the middle of the step beyond that of its start.
double EnergyAccounting::work_ahead_of_servos(const SolvedSubstep& substep) const {
  double work = 0.0;
  const std::vector<double>& change = substep.motion.servo_change();
  if (change.empty()) return work;
  for (int index = 0; index < substep.motion.tree_count(); ++index) {
    if (!substep.motion.is_sprung(index)) continue;
    const Tree& tree = substep.motion.trees().tree[index];
    for (int i = tree.dof_begin; i < tree.dof_begin + tree.dof_count; ++i)
      work += change[i] * displacement_[i];
  }
  return work;
}

void EnergyAccounting::lose_motion(const mjData_* d, const SolvedSubstep& substep,
                                   const std::vector<int>& trees, Memory& memory) {
  std::vector<double> velocity(displacement_.size()), momentum(displacement_.size());
  for (int index : trees) {
    const Tree& tree = substep.motion.trees().tree[index];
    std::copy_n(host::velocity(d) + tree.dof_begin, tree.dof_count,
                velocity.begin() + tree.dof_begin);
  }
  host::times_inertia(substep.model, d, velocity.data(), momentum.data());
  for (size_t i = 0; i < velocity.size(); ++i)
    ledger_.dissipated_damping += 0.5 * velocity[i] * momentum[i];
  memory.set_ledger(ledger_);
}

}  // namespace dashpot
