#include "step_forces.hpp"

#include <algorithm>

#include "dashpot/law/friction.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/host.hpp"

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

void StepForces::start(const Rows& rows) {
  borne_.assign(rows.appended, 0.0);
  report_others_ = false;
}

void StepForces::find(mjData_* d, const SolvedSubstep& substep, Team& team) {
  of_microsteps_.assign(substep.motion.start_velocity().size(), 0.0);
  team.for_each(substep.motion.tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = substep.motion.trees().tree[index];
    if (substep.on_trees.touched[index])
      substep.motion.to_generalized_force(index,
                                          substep.data.coordinate_impulse.data() + tree.begin,
                                          of_microsteps_.data() + tree.dof_begin);
  });
  for (double& force : of_microsteps_) force /= substep.length;
  host::set_forces(substep.model, d, substep.motion.trees(), substep.motion.smooth_acceleration(),
                   of_microsteps_);
}

void StepForces::leave_out_untouched(mjData_* d, const SolvedSubstep& substep,
                                     std::vector<ContactInput>& contacts) {
  contact_touched_.assign(host::detected_count(d), 0);
  for (size_t i = 0; i < substep.rows.group.size(); ++i) {
    const RowGroup& c = substep.rows.group[i];
    if (c.kind == RowKind::kContact && (substep.data.touched[i] || has_borne(c)))
      contact_touched_[contacts[c.input].source] = 1;
  }
  if (host::leave_out_untouched(substep.model, d, contact_touched_, contacts))
    host::make_contact_sensors(substep.model, d);
}

bool StepForces::has_borne(const RowGroup& c) const {
  const auto first = borne_.begin() + c.row;
  return std::any_of(first, first + c.dim, [](double impulse) { return impulse != 0.0; });
}

// Finds the generalized forces and accelerations of the step where they are others than those that
// MuJoCo's integrator takes, as those of free bodies are not.
void StepForces::find_reported(const mjData_* d, const SolvedSubstep& substep) {
  const std::vector<Tree>& trees = substep.motion.trees().tree;
  const bool all_free =
      std::all_of(trees.begin(), trees.end(), [](const Tree& tree) { return tree.free_body; });
  borne_wrench_.assign(substep.motion.trees().coordinates, 0.0);
  for (const RowGroup& c : substep.rows.group) {
    if (!has_borne(c)) continue;
    if (c.kind == RowKind::kContact) keep_borne_inside_cone(substep, c);
    if (all_free || !has_borne(c)) continue;
    scatter(substep.rows, c, borne_.data() + c.row, borne_wrench_.data());
    report_others_ = true;
  }
  if (all_free) return;
  reported_ = of_microsteps_;
  const double* acceleration = host::acceleration(d);
  reported_acceleration_.assign(acceleration, acceleration + of_microsteps_.size());
  for (int index = 0; index < substep.motion.tree_count(); ++index) {
    const Tree& tree = trees[index];
    if (tree.free_body) continue;
    for (int i = 0; i < tree.dof_count; ++i)
      reported_[tree.dof_begin + i] += borne_wrench_[tree.begin + i] / substep.length;
    if (!substep.motion.is_accurate(index)) find_mean_acceleration(index, substep);
  }
}

// Rows held over a step bear what would pull a foot that is about to leave, or hold one that slips:
// as much is reported as a contact can exert. Cones are convex.
void StepForces::keep_borne_inside_cone(const SolvedSubstep& substep, const RowGroup& c) {
  const double* impulse = substep.data.total_impulse.data() + c.row;
  double* more = borne_.data() + c.row;
  const auto is_inside = [&](double share) {
    return is_inside_cone(substep.rows, c, impulse, more, share, substep.length);
  };
  if (is_inside(1.0)) return;
  double inside = 0.0, outside = 1.0;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (inside + outside);
    (is_inside(middle) ? inside : outside) = middle;
  }
  for (int i = 0; i < c.dim; ++i) more[i] *= inside;
}

// That of a tree's motion over the step where rows hold it: qacc has neither its Verlet corrector
// nor what the effective inertia makes of forces. Of linkages qacc stays: in the force of
// equalities is nothing of how they turn in the Verlet corrector.
void StepForces::find_mean_acceleration(int index, const SolvedSubstep& substep) {
  const Tree& tree = substep.motion.trees().tree[index];
  double* mean = reported_acceleration_.data() + tree.dof_begin;
  if (!substep.on_trees.held[index] || substep.trapezoid.is_coupled_by_equalities(index)) return;
  for (int i = 0; i < tree.dof_count; ++i) {
    const int k = tree.begin + i;
    mean[i] = (substep.data.velocity[k] - substep.data.start_motion[k]) / substep.length;
  }
  report_others_ = true;
}

void StepForces::report(mjData_* d, const SolvedSubstep& substep) {
  of_row_ = substep.data.total_impulse;
  for (size_t row = 0; row < of_row_.size(); ++row)
    of_row_[row] = (of_row_[row] + borne_[row]) / substep.length;
  if (report_others_) exchange(d);
  host::report_forces(substep.model, d, substep.contacts, substep.constraints, substep.rows,
                      of_row_);
}

void StepForces::exchange(mjData_* d) {
  host::exchange_forces(d, reported_, reported_acceleration_);
}

}  // namespace dashpot
