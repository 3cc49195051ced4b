// The forces of a step: those under which MuJoCo's integrator moves trees, and, with what rows bore
// beside them, those that MuJoCo's fields and sensors report.

#include <algorithm>

#include "dashpot/law/friction.hpp"
#include "dashpot/mujoco/contacts.hpp"
#include "dashpot/mujoco/host.hpp"
#include "dashpot/mujoco/properties.hpp"
#include "dashpot/mujoco/state.hpp"
#include "stepper_impl.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 64;  // by a thread
constexpr int kHalvings = 30;     // of the part of an impulse that is looked for

// Whether `impulse` + part * `more`, over `length` (s), is one that the rows of a contact can
// exert (law/friction.hpp).
bool is_inside_cone(const Rows& rows, const RowGroup& c, const double* impulse, const double* more,
                    double part, double length) {
  double sum[kMaxRows];
  for (int i = 0; i < c.dim; ++i) sum[i] = impulse[i] + part * more[i];
  if (sum[0] < 0.0) return false;
  const double share = share_under_load(c.loaded_friction, c.friction_load, sum[0] / length);
  const double* mu = rows.friction.data() + c.row + 1;
  return radial_return(sum + 1, mu, c.dim - 1, share * sum[0]) == 1.0;
}

}  // namespace

// Those of the micro-steps.
void Stepper::Impl::find_forces(mjData_* d) {
  forces.borne.assign(rows.appended, 0.0);
  trapezoid.add_borne(forces.borne);
  leave_out_untouched(d);
  forces.constraint.assign(motion.start_velocity().size(), 0.0);
  team.for_each(motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = motion.trees().tree[index];
    if (on_trees.touched[index])
      motion.to_generalized_force(index, data.coordinate_impulse.data() + tree.begin,
                                  forces.constraint.data() + tree.dof_begin);
  });
  for (double& force : forces.constraint) force /= clock.length;
  host::set_forces(model, d, forces.constraint);
}

void Stepper::Impl::leave_out_untouched(mjData_* d) {
  if (detection.contact_rows == host::ContactRows::kNone) return;  // nobody looks at them
  forces.contact_touched.assign(host::detected_count(d), 0);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind == RowKind::kContact && (data.touched[i] || has_borne(c)))
      forces.contact_touched[contacts[c.input].source] = 1;
  }
  if (host::leave_out_untouched(model, d, forces.contact_touched, contacts))
    host::make_contact_sensors(model, d);
}

bool Stepper::Impl::has_borne(const RowGroup& c) const {
  const auto first = forces.borne.begin() + c.row;
  return std::any_of(first, first + c.dim, [](double impulse) { return impulse != 0.0; });
}

// Of RK4. Who looks at its stages sees the sensors of the step there.
void Stepper::Impl::find_stages(mjData_* d, bool new_control) {
  forces.report_more = false;
  if (!host::is_runge_kutta(model)) return;
  if (host::others_look_at_stages(model)) report_to_sensors(d);
  add_second_halves_in_flight(d);
  for (int index = 0; index < motion.tree_count(); ++index)
    if (on_trees.touched[index]) motion.leave_dampers_to_stages(d, index);
  held_stages.find(rows, data, motion.trees(), data.start_motion, trapezoid.added_velocity(),
                   on_trees.held, clock.length);
  try {
    runge_kutta.find_motion(model, d, new_control, held_stages, find_contacts);
  } catch (...) {
    host::set_velocity(d, motion.start_velocity());
    throw;
  }
  host::set_velocity(d, motion.start_velocity());
}

void Stepper::Impl::report_forces(mjData_* d) {
  const bool comfree = parameters.options.law == Law::kComFree;
  const bool stages = host::is_runge_kutta(model);
  if (!comfree) {
    find_unpaid(d);
    for (int index = 0; index < motion.tree_count(); ++index)
      if (!motion.is_accurate(index))
        motion.find_integrated(d, index, clock.length, rows_on_tree(index, stages), data);
    if (stages) add_borne_in_stages();
    keep_borne_inside_cones();
    find_reported(d);
  }
  if (stages && host::others_look_at_stages(model) && !forces.report_more) return;
  report_to_sensors(d);
}

void Stepper::Impl::add_borne_in_stages() {
  for (int index = 0; index < motion.tree_count(); ++index)
    if (!motion.is_accurate(index) && has_stages(index)) held_stages.add_borne(index, forces.borne);
}

// Rows held over a step bear what would pull a foot that is about to leave, or hold one that slips:
// as much is reported as a contact can exert. Cones are convex.
void Stepper::Impl::keep_borne_inside_cones() {
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact || !has_borne(c)) continue;
    const double* impulse = data.total_impulse.data() + c.row;
    double* more = forces.borne.data() + c.row;
    if (is_inside_cone(rows, c, impulse, more, 1.0, clock.length)) continue;
    double inside = 0.0, outside = 1.0;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = 0.5 * (inside + outside);
      (is_inside_cone(rows, c, impulse, more, middle, clock.length) ? inside : outside) = middle;
    }
    for (int i = 0; i < c.dim; ++i) more[i] *= inside;
  }
}

// Finds the generalized forces and accelerations of the step where they are others than those that
// MuJoCo's integrator takes, as those of free bodies are not.
void Stepper::Impl::find_reported(const mjData_* d) {
  const std::vector<Tree>& trees = motion.trees().tree;
  if (std::all_of(trees.begin(), trees.end(), [](const Tree& tree) { return tree.free_body; }))
    return;
  forces.reported = forces.constraint;
  forces.borne_wrench.assign(motion.trees().coordinates, 0.0);
  for (const RowGroup& c : rows.group) {
    if (!has_borne(c)) continue;
    scatter(rows, c, forces.borne.data() + c.row, forces.borne_wrench.data());
    forces.report_more = true;
  }
  const double* acceleration = host::acceleration(d);
  forces.reported_acceleration.assign(acceleration, acceleration + forces.constraint.size());
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& tree = trees[index];
    if (tree.free_body) continue;
    for (int i = 0; i < tree.dof_count; ++i)
      forces.reported[tree.dof_begin + i] += forces.borne_wrench[tree.begin + i] / clock.length;
    if (!motion.is_accurate(index)) find_mean_acceleration(index);
  }
}

// That of a tree's motion over the step where rows hold it: qacc has neither its second half nor
// what the effective inertia makes of forces. In flight the half is added. Of linkages qacc stays:
// in the force of equalities is nothing of how they turn in the second half.
void Stepper::Impl::find_mean_acceleration(int index) {
  const Tree& tree = motion.trees().tree[index];
  double* mean = forces.reported_acceleration.data() + tree.dof_begin;
  if (gets_second_half_in_flight(index)) {
    const double* added = trapezoid.added_velocity() + tree.begin;
    for (int i = 0; i < tree.dof_count; ++i) mean[i] += added[i] / clock.length;
    forces.report_more = true;
  }
  if (!on_trees.held[index] || trapezoid.is_coupled_by_equalities(index)) return;
  if (has_stages(index)) {
    std::copy_n(runge_kutta.mean_acceleration().begin() + tree.dof_begin, tree.dof_count, mean);
  } else if (!motion.integrated()[index]) {
    for (int i = 0; i < tree.dof_count; ++i) {
      const int k = tree.begin + i;
      mean[i] = (data.velocity[k] - data.start_motion[k]) / clock.length;
    }
  }
  forces.report_more = true;
}

void Stepper::Impl::report_to_sensors(mjData_* d) {
  forces.of_row = data.total_impulse;
  for (size_t row = 0; row < forces.of_row.size(); ++row)
    forces.of_row[row] = (forces.of_row[row] + forces.borne[row]) / clock.length;
  if (forces.report_more) host::exchange_forces(d, forces.reported, forces.reported_acceleration);
  host::report_forces(model, d, contacts, constraints, rows, forces.of_row);
}

}  // namespace dashpot
