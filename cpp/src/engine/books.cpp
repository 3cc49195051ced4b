// The books of a step: work and energies, memory, statistics.

#include <algorithm>

#include "dashpot/mujoco/forces.hpp"
#include "dashpot/mujoco/host.hpp"
#include "dashpot/mujoco/state.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 64;  // by a thread

}  // namespace

// Work of contacts, because they turn, that no spring paid for: no more than all contacts together
// did too much. Shared by two trees as their relative motion is.
void Stepper::Impl::find_unpaid(mjData_* d) {
  on_trees.unpaid.assign(motion.tree_count(), 0.0);
  const EnergyLedger start = memory(d).ledger();
  const double gained = start.dissipated_by_contacts() - ledger.dissipated_by_contacts();
  if (gained <= 0.0) return;
  double all = 0.0;
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    const double energy = -data.turning_work[i];
    if (energy <= 0.0 || rows.inverse_mass[c.row] == 0.0) continue;
    all += energy;
    for (int side = 0; side < 2; ++side)
      if (c.tree[side] >= 0)
        on_trees.unpaid[c.tree[side]] +=
            energy * rows.tree_inverse_mass[c.row][side] / rows.inverse_mass[c.row];
  }
  if (all > gained)
    for (double& energy : on_trees.unpaid) energy *= gained / all;
}

// Whether a tree went the way of the stages of RK4, or its velocity comes from them.
bool Stepper::Impl::has_stages(int tree) const {
  return host::is_runge_kutta(model) && motion.integrated()[tree];
}

bool Stepper::Impl::goes_as_in_microsteps(int tree) const {
  return on_trees.touched[tree] && (on_trees.held[tree] || !has_stages(tree));
}

// Trees that rows moved went the integral of their velocity and what recovery displaced them; the
// change of kinetic energy of all others goes with their mean velocity, also that of trees which
// dry friction alone slows where RK4 integrates them: that of its stages.
void Stepper::Impl::find_mean_displacement(const mjData_* d) {
  const double* velocity = host::velocity(d);
  const std::vector<double>& start_velocity = motion.start_velocity();
  ways.mean.resize(start_velocity.size());
  ways.added_velocity.assign(start_velocity.size(), 0.0);
  ways.beyond_stages.assign(start_velocity.size(), 0.0);
  ways.recovered.assign(start_velocity.size(), 0.0);
  const bool comfree = parameters.options.law == Law::kComFree;
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    double* mean = ways.mean.data() + tree.dof_begin;
    for (int i = 0; i < tree.dof_count; ++i) {
      const int dof = tree.dof_begin + i;
      mean[i] = has_stages(index) ? clock.length * runge_kutta.mean_velocity()[dof]
                                  : 0.5 * clock.length * (start_velocity[dof] + velocity[dof]);
    }
    if (comfree) return;
    if (gets_second_half_in_flight(index) && !has_stages(index)) {
      const double* added = trapezoid.added_velocity() + tree.begin;
      for (int i = 0; i < tree.dof_count; ++i) {
        mean[i] += 0.5 * clock.length * added[i];
        ways.added_velocity[tree.dof_begin + i] = added[i];
      }
    }
    if (!goes_as_in_microsteps(index)) return;
    double* beyond = ways.beyond_stages.data() + tree.dof_begin;
    if (has_stages(index))
      for (int i = 0; i < tree.dof_count; ++i) beyond[i] = -mean[i];
    double* shift = ways.recovered.data() + tree.dof_begin;
    motion.to_generalized(index, data.total_displacement.data() + tree.begin, mean);
    motion.to_generalized(index, ways.recovery.data() + tree.begin, shift);
    for (int i = 0; i < tree.dof_count; ++i) mean[i] -= shift[i];
    if (!tree.free_body)
      for (int i = 0; i < tree.dof_count; ++i) mean[i] -= data.shift[tree.begin + i];
    if (has_stages(index))
      for (int i = 0; i < tree.dof_count; ++i) beyond[i] += mean[i];
  });
}

// Over a way x from the shift s on, -k (s + x / 2) in the mean.
void Stepper::Impl::find_spring_changes() {
  ways.spring_change.clear();
  const Trees& trees = motion.trees();
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& tree = trees.tree[index];
    if (!tree.sprung || !goes_as_in_microsteps(index)) continue;
    ways.spring_change.resize(ways.mean.size(), 0.0);
    for (int i = 0; i < tree.dof_count; ++i) {
      const int dof = tree.dof_begin + i, k = tree.begin + i;
      ways.spring_change[dof] =
          -trees.stiffness[k] * (leapfrog.way_back()[k] + 0.5 * ways.mean[dof]);
    }
  }
}

void Stepper::Impl::account_smooth_work(mjData_* d) {
  find_mean_displacement(d);
  find_spring_changes();
  if (trapezoid.load())
    for (int index = 0; index < motion.tree_count(); ++index) {
      if (!goes_as_in_microsteps(index)) continue;
      const Tree& tree = motion.trees().tree[index];
      for (int i = tree.dof_begin; i < tree.dof_begin + tree.dof_count; ++i)
        ledger.work += trapezoid.load()[i] * ways.mean[i];
    }
  ledger.dissipated_recovery += host::potential_work(model, d, ways.recovered.data());
  smooth_work.find(
      model, d, motion.trees(),
      {motion.start_velocity().data(), ways.mean.data(), motion.smooth_acceleration().data(),
       &on_trees.touched, host::is_runge_kutta(model) ? &runge_kutta.forces() : nullptr,
       ways.beyond_stages.data(), &motion.integrated(), data.braked.data(),
       ways.added_velocity.data(), ways.spring_change});
  ledger.dissipated_damping -= smooth_work.damping;
  ledger.work += smooth_work.applied + work_ahead_of_servos();
  leave_to_rows_by_stages(d);
  book_left_to_rows(rows, data, smooth_work.group, smooth_work.left_to_rows, ledger);
  for (const RowGroup& c : rows.group)
    ledger.work += surface_work(rows, c, data.total_impulse.data() + c.row);
  for (double work : data.acceleration_work) ledger.work -= work;
}

// Adds to what is left to rows what they are booked to have given beyond what they gave trees that
// RK4 moved (stage_work.hpp). Where they have done nothing but displace one, recovery has it.
void Stepper::Impl::leave_to_rows_by_stages(mjData_* d) {
  if (!host::is_runge_kutta(model) || parameters.options.law == Law::kComFree) return;
  if (std::none_of(on_trees.touched.begin(), on_trees.touched.end(), [](char any) { return any; }))
    return;
  stage_work.find(model, d, runge_kutta, motion.start_velocity(), ways.beyond_stages);
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!on_trees.touched[index] || !has_stages(index)) continue;
    const Tree& tree = motion.trees().tree[index];
    bool pushed = false;
    double left = 0.0;
    for (int i = 0; i < tree.dof_count; ++i) {
      const int dof = tree.dof_begin + i, k = tree.begin + i;
      const double even = 0.5 * clock.length * (data.start_motion[k] + data.velocity[k]);
      left += forces.constraint[dof] * even +
              host::smooth_force(d, dof) * (even - ways.of_microsteps[k]) -
              stage_work.of_rows()[dof];
      if (held_stages.has_mean_springs(index))
        left += data.pulled[k] * (even - (ways.mean[dof] - ways.beyond_stages[dof])) / clock.length;
      pushed |= forces.constraint[dof] != 0.0;
    }
    if (pushed)
      smooth_work.left_to_rows[smooth_work.group[index]] += left;
    else
      ledger.dissipated_recovery += left;
  }
}

// Work that servos did on free bodies by the force of the middle of the step beyond that of its
// start.
double Stepper::Impl::work_ahead_of_servos() const {
  double work = 0.0;
  if (motion.servo_change().empty()) return work;
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!motion.is_sprung(index) || motion.integrated()[index]) continue;
    const Tree& tree = motion.trees().tree[index];
    for (int i = tree.dof_begin; i < tree.dof_begin + tree.dof_count; ++i)
      work += motion.servo_change()[i] * ways.mean[i];
  }
  return work;
}

// Springs of what sleeps keep their energy.
void Stepper::Impl::start_books(const Memory& view) {
  ledger = view.ledger();
  elastic_asleep = view.energy(sleeping);
  ledger.elastic -= elastic_asleep;
}

void Stepper::Impl::remember(mjData_* d, const host::MocapMotion& mocap) {
  Memory view = memory(d);
  mocap.remember(view);
  view.remember(contacts, constraints, rows, data, sleeping, team);
  if (double* end_velocity = view.end_velocity())
    std::copy_n(host::velocity(d), motion.start_velocity().size(), end_velocity);
  leapfrog.keep(clock.length, on_trees.held, motion, view);
  const bool leaves_half = parameters.options.law != Law::kComFree && !geometry_of_middle;
  trapezoid.keep(d,
                 {clock.length, leaves_half, constraints, rows, data, on_trees.held,
                  leapfrog.fell_back(), leapfrog.way_back(), ways.mean},
                 motion, view, ledger);
  ledger.elastic += elastic_asleep;
  view.set_ledger(ledger);
}

StepStats Stepper::Impl::statistics() const {
  StepStats stats;
  stats.contacts = static_cast<int>(contacts.size());
  stats.islands = static_cast<int>(islands.all().size());
  for (const Island& island : islands.all()) {
    stats.microsteps = std::max(stats.microsteps, island.microsteps);
    stats.clipped += island.clipped;
  }
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact) continue;
    stats.touching += data.touched[i];
    stats.max_penetration = std::max(stats.max_penetration, -contacts[c.input].gap);
    stats.max_compression = std::max(stats.max_compression, -data.deformation[c.row]);
  }
  return stats;
}

}  // namespace dashpot
