#include "dashpot/motion/leapfrog.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dashpot/mujoco/runge_kutta.hpp"
#include "dashpot/mujoco/trees.hpp"

namespace dashpot {

namespace {

bool is_of_any(const RowGroup& c, const std::vector<char>& of_tree) {
  if (c.kind == RowKind::kSlider) return false;
  return std::any_of(c.tree.begin(), c.tree.end(),
                     [&](int tree) { return tree >= 0 && of_tree[tree]; });
}

// Keeps the trees of a row from leading.
void stop(const RowGroup& c, std::vector<char>& leads) {
  for (int tree : c.tree)
    if (tree >= 0) leads[tree] = 0;
}

// Takes what the trees of a row go ahead by off their way.
void take_off(const RowGroup& c, const Trees& trees, AlignedDoubles& ahead, AlignedDoubles& way) {
  for (int tree : c.tree) {
    if (tree < 0) continue;
    const Tree& t = trees.tree[tree];
    for (int i = t.begin; i < t.begin + t.count; ++i) way[i] -= std::exchange(ahead[i], 0.0);
  }
}

// Whether a way, by motion coordinate, closes the gap of a row.
bool enters(const Rows& rows, const RowGroup& c, double gap, const AlignedDoubles& way) {
  const double closing = first_rate(rows, c, way);
  return closing < 0.0 && gap + closing <= 0.0;
}

// The gap of a row, or its compression, after the shift of positions.
double shifted_gap(const Rows& rows, const RowGroup& c, const RowData& data) {
  return data.deformation[c.row] + first_rate(rows, c, data.shift);
}

}  // namespace

void Leapfrog::find_leads(const mjModel_* model, const Memory& memory, const TreeMotion& motion) {
  in_time_.assign(motion.tree_count(), 0);
  lead_at_start_.assign(motion.tree_count(), 0.0);
  leapfrogs_.clear();
  const double* lead = memory.lead();
  if (!lead) return;
  leapfrogs_.resize(motion.tree_count());
  for (int index = 0; index < motion.tree_count(); ++index) {
    leapfrogs_[index] = !host::is_free_body(model, index) && !host::is_runge_kutta(model) &&
                        !motion.sleeps(index) && !motion.trees().has_implicit_springs(index);
    const Tree& t = motion.trees().tree[index];
    const double* velocity = motion.start_velocity().data() + t.dof_begin;
    if (!leapfrogs_[index] ||
        !std::equal(velocity, velocity + t.dof_count, memory.end_velocity() + t.dof_begin))
      continue;
    lead_at_start_[index] = lead[index];
    in_time_[index] = lead_at_start_[index] == 0.0;
  }
}

void Leapfrog::fall_back(const Memory& memory, const TreeMotion& motion, Rows& rows,
                         RowData& data) {
  leads_late_.assign(motion.tree_count(), 0);
  recovers_.assign(motion.tree_count(), 0);
  fell_back_.assign(motion.tree_count(), 0.0);
  way_back_.assign(motion.trees().coordinates, 0.0);
  if (!memory.lead()) return;
  find_recovering(rows, data);
  start_velocity_ = data.velocity;
  start_gap_ = data.deformation;
  if (!find_way_back(motion, data)) return;
  take_gaps_back(rows, data);
  take_times_back(rows);
  for (size_t i = 0; i < data.shift.size(); ++i) data.total_displacement[i] += data.shift[i];
  way_back_ = data.shift;
}

void Leapfrog::find_acceleration(const Trees& trees, int index, const AlignedDoubles& way,
                                 const RowData& data) {
  const Tree& t = trees.tree[index];
  acceleration_.resize(trees.coordinates);
  pull_.resize(trees.coordinates);
  std::copy_n(data.smooth_acceleration.begin() + t.begin, t.count, acceleration_.begin() + t.begin);
  if (!t.sprung) return;
  for (int i = t.begin; i < t.begin + t.count; ++i) pull_[i] = -trees.stiffness[i] * way[i];
  if (t.elastic)
    add_implicit(trees, index, 0.0, -1.0, way.data() + t.begin, pull_.data() + t.begin);
  add_response(trees, index, pull_.data() + t.begin, acceleration_.data() + t.begin);
}

void Leapfrog::find_recovering(const Rows& rows, const RowData& data) {
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!c.is_unilateral() || data.offset[i] <= std::abs(data.deformation[c.row])) continue;
    for (int tree : c.tree)
      if (tree >= 0) recovers_[tree] = 1;
  }
}

bool Leapfrog::find_way_back(const TreeMotion& motion, RowData& data) {
  bool any = false;
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (lead_at_start_[index] == 0.0) continue;
    any = true;
    fell_back_[index] = lead_at_start_[index];
    const Tree& t = motion.trees().tree[index];
    const double lead = lead_at_start_[index];
    double* shift = data.shift.data() + t.begin;
    for (int i = 0; i < t.dof_count; ++i)
      shift[i] = -lead * motion.start_velocity()[t.dof_begin + i];
    find_acceleration(motion.trees(), index, data.shift, data);
    for (int i = 0; i < t.dof_count; ++i)
      shift[i] -= 0.5 * lead * lead * acceleration_[t.begin + i];
  }
  return any;
}

// Rows that trees have left compressed were more so; those that they have come into ahead of their
// velocities, and that remember nothing, were not reached.
void Leapfrog::take_gaps_back(const Rows& rows, RowData& data) {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (!c.is_unilateral()) continue;
    double& deformation = data.deformation[c.row];
    if (deformation < 0.0) {
      deformation = std::min(0.0, shifted_gap(rows, c, data));
    } else {
      const double gap = shifted_gap(rows, c, data) - data.offset[index];
      deformation = std::max(0.0, gap);
      data.offset[index] = std::max(0.0, -gap);
    }
  }
}

// The geometry of a row is that of a time after q, which is later by the lead that trees gave up.
void Leapfrog::take_times_back(Rows& rows) const {
  for (RowGroup& c : rows.group)
    if (const double later = mean_of_trees(c.tree, fell_back_); later > 0.0) c.ahead += later;
}

// Trees do not go into a row with the semi-implicit update, either.
void Leapfrog::find_late(double stride, const std::vector<char>& held, const TreeMotion& motion,
                         const Rows& rows, const RowData& data) {
  for (int index = 0; index < motion.tree_count(); ++index)
    leads_late_[index] = in_time_[index] && !held[index];
  for (const RowGroup& c : rows.group)
    if (c.kind == RowKind::kBilateral) stop(c, leads_late_);
  if (std::find(leads_late_.begin(), leads_late_.end(), 1) == leads_late_.end()) return;
  late_way_.assign(motion.trees().coordinates, 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = motion.trees().tree[index];
    for (int i = t.begin; i < t.begin + t.dof_count && leads_late_[index]; ++i)
      late_way_[i] = 0.5 * stride * start_velocity_[i];
  }
  find_next_way(stride, start_velocity_, data, late_way_);
  for (bool stopped = true; stopped;) {
    stopped = false;
    for (const RowGroup& c : rows.group) {
      if (!is_of_any(c, leads_late_) || !enters(rows, c, start_gap_[c.row], next_way_)) continue;
      stopped = true;
      stop(c, leads_late_);
      take_off(c, motion.trees(), late_way_, next_way_);
    }
  }
}

// The way is that of the semi-implicit update from `velocity`, and what goes ahead of it.
void Leapfrog::find_next_way(double stride, const AlignedDoubles& velocity, const RowData& data,
                             const AlignedDoubles& ahead) {
  next_way_ = ahead;
  for (size_t i = 0; i < next_way_.size(); ++i)
    next_way_[i] += stride * (velocity[i] + stride * data.smooth_acceleration[i]);
}

void Leapfrog::go_ahead(double stride, const std::vector<char>& held, const TreeMotion& motion,
                        const Rows& rows, RowData& data) {
  if (leapfrogs_.empty()) return;
  find_late(stride, held, motion, rows, data);
  leads_.resize(motion.tree_count());
  for (int index = 0; index < motion.tree_count(); ++index)
    leads_[index] = leapfrogs_[index] && held[index] && !recovers_[index];
  for (const RowGroup& c : rows.group) {
    if (c.kind == RowKind::kSlider) continue;
    const double gap = data.deformation[c.row];
    const double force = -rows.stiffness[c.row] * gap - rows.damping[c.row] * data.rate[c.row];
    if (!c.is_unilateral() || (gap < 0.0 && force > 0.0)) stop(c, leads_);
  }
  if (std::find(leads_.begin(), leads_.end(), 1) == leads_.end()) return;
  way_ahead_.assign(motion.trees().coordinates, 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = motion.trees().tree[index];
    if (leads_[index]) find_acceleration(motion.trees(), index, data.total_displacement, data);
    for (int i = t.begin; i < t.begin + t.dof_count && leads_[index]; ++i)
      way_ahead_[i] = 0.5 * stride * (data.velocity[i] + 0.25 * stride * acceleration_[i]);
  }
  find_next_way(stride, data.velocity, data, way_ahead_);
  // No tree goes into another row, nor where the next step would take it into one: what leaves a
  // row for less than a step would go ahead and fall back for nothing.
  for (bool stopped = true; stopped;) {
    stopped = false;
    for (const RowGroup& c : rows.group) {
      if (!is_of_any(c, leads_)) continue;
      const double gap = data.deformation[c.row];
      if (!enters(rows, c, gap, way_ahead_) && !enters(rows, c, gap, next_way_)) continue;
      stopped = true;
      stop(c, leads_);
      take_off(c, motion.trees(), way_ahead_, next_way_);
    }
  }
  for (const RowGroup& c : rows.group)
    if (is_of_any(c, leads_)) data.deformation[c.row] += first_rate(rows, c, way_ahead_);
  for (size_t i = 0; i < way_ahead_.size(); ++i) {
    data.shift[i] += way_ahead_[i];
    data.total_displacement[i] += way_ahead_[i];
  }
}

void Leapfrog::keep(double stride, const std::vector<char>& held, const TreeMotion& motion,
                    Memory& memory) const {
  double* lead = memory.lead();
  if (!lead) return;
  for (int index = 0; index < motion.tree_count(); ++index) {
    const bool leads = !leapfrogs_.empty() && leapfrogs_[index] &&
                       (held[index] ? leads_[index] : !in_time_[index] || leads_late_[index]);
    lead[index] = leads ? 0.5 * stride : 0.0;
  }
}

}  // namespace dashpot
