#include "dashpot/leapfrog.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_trees.hpp"
#include "dashpot/runge_kutta.hpp"

namespace dashpot {

namespace {

void stay(const Tree& tree, AlignedDoubles& shift) {
  std::fill_n(shift.begin() + tree.begin, tree.count, 0.0);
}

}  // namespace

void Leapfrog::fall_back(const mjModel_* model, const Memory& memory, const TreeMotion& motion,
                         const Rows& rows, RowData& data) {
  in_time_.assign(motion.tree_count(), 0);
  may_lead_.assign(motion.tree_count(), 0);
  recovers_.assign(motion.tree_count(), 0);
  fell_back_.assign(motion.tree_count(), 0.0);
  still_leads_.assign(motion.tree_count(), 0);
  const double* length = memory.leading_length();
  leapfrogs_.clear();
  if (!length) return;
  leapfrogs_.resize(motion.tree_count());
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!c.is_unilateral() || data.offset[i] <= std::abs(data.deformation[c.row])) continue;
    for (int tree : c.tree)
      if (tree >= 0) recovers_[tree] = 1;
  }
  start_velocity_ = data.velocity;
  start_gap_ = data.deformation;
  bool any = false;
  for (int index = 0; index < motion.tree_count(); ++index) {
    leapfrogs_[index] = !host::is_free_body(model, index) && !host::is_runge_kutta(model);
    const Tree& t = motion.trees().tree[index];
    const double* velocity = motion.start_velocity().data() + t.dof_begin;
    if (!leapfrogs_[index] ||
        !std::equal(velocity, velocity + t.dof_count, memory.end_velocity() + t.dof_begin))
      continue;
    in_time_[index] = length[index] == 0.0;
    if (in_time_[index]) continue;
    any = true;
    fell_back_[index] = length[index];
    for (int i = 0; i < t.dof_count; ++i)
      data.shift[t.begin + i] = -0.5 * length[index] * velocity[i];
  }
  if (!any) return;
  const auto gap_in_time = [&](const RowGroup& c) {
    double way[kMaxRows];
    gather(rows, c, data.shift.data(), way);
    return data.deformation[c.row] + way[0];
  };
  const auto is_apart = [&](const RowGroup& c) {
    return c.is_unilateral() && data.deformation[c.row] > 0.0;
  };
  // Where the way back is barred, by a second limit as a rule, they stay; which may bar it for
  // others.
  for (bool barred = true; barred;) {
    barred = false;
    for (const RowGroup& c : rows.group) {
      if (!is_apart(c) || gap_in_time(c) > 0.0) continue;
      for (int tree : c.tree) {
        if (tree < 0 || fell_back_[tree] == 0.0) continue;
        barred = true;
        stay(motion.trees().tree[tree], data.shift);
        fell_back_[tree] = 0.0;
        still_leads_[tree] = 1;
      }
    }
  }
  // Those that they have left compressed were more so; those that they have come into ahead of
  // their velocities, and that remember nothing, were not reached.
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (!c.is_unilateral()) continue;
    double& deformation = data.deformation[c.row];
    if (deformation < 0.0) {
      deformation = std::min(0.0, gap_in_time(c));
    } else {
      const double gap = gap_in_time(c) - data.offset[index];
      deformation = std::max(0.0, gap);
      data.offset[index] = std::max(0.0, -gap);
    }
  }
  for (size_t i = 0; i < data.shift.size(); ++i) data.total_displacement[i] += data.shift[i];
}

// Not into a row with the semi-implicit update, either.
void Leapfrog::find_late(double length, const std::vector<char>& held, const TreeMotion& motion,
                         const Rows& rows, const RowData& data) {
  for (int index = 0; index < motion.tree_count(); ++index)
    may_lead_[index] = in_time_[index] && !held[index];
  if (std::find(may_lead_.begin(), may_lead_.end(), 1) == may_lead_.end()) return;
  const auto bar = [&](const RowGroup& c) {
    for (int tree : c.tree)
      if (tree >= 0) may_lead_[tree] = 0;
  };
  for (const RowGroup& c : rows.group)
    if (c.kind == RowKind::kBilateral) bar(c);
  late_.assign(motion.trees().coordinates, 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = motion.trees().tree[index];
    for (int i = t.begin; i < t.begin + t.dof_count && may_lead_[index]; ++i)
      late_[i] = 0.5 * length * start_velocity_[i];
  }
  way_ = late_;
  for (size_t i = 0; i < way_.size(); ++i)
    way_[i] += length * (start_velocity_[i] + length * data.smooth_acceleration[i]);
  const auto may_lead = [&](int tree) { return tree >= 0 && may_lead_[tree]; };
  for (const RowGroup& c : rows.group) {
    if (c.kind == RowKind::kSlider || !(may_lead(c.tree[0]) || may_lead(c.tree[1]))) continue;
    double way[kMaxRows];
    gather(rows, c, way_.data(), way);
    if (way[0] < 0.0 && start_gap_[c.row] + way[0] <= 0.0) bar(c);
  }
}

void Leapfrog::lead(double length, const std::vector<char>& held, const TreeMotion& motion,
                    const Rows& rows, RowData& data) {
  if (leapfrogs_.empty()) return;
  find_late(length, held, motion, rows, data);
  leads_.resize(motion.tree_count());
  for (int index = 0; index < motion.tree_count(); ++index)
    leads_[index] = leapfrogs_[index] && held[index] && !recovers_[index];
  for (const RowGroup& c : rows.group) {
    if (c.kind == RowKind::kSlider) continue;
    const double gap = data.deformation[c.row];
    const double force = -rows.stiffness[c.row] * gap - rows.damping[c.row] * data.rate[c.row];
    if (!c.is_unilateral() || (gap < 0.0 && force > 0.0)) stop(c);
  }
  if (std::find(leads_.begin(), leads_.end(), 1) == leads_.end()) return;
  ahead_.assign(motion.trees().coordinates, 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    const Tree& t = motion.trees().tree[index];
    const bool goes = leads_[index] && !still_leads_[index];
    for (int i = t.begin; i < t.begin + t.dof_count && goes; ++i)
      ahead_[i] = 0.5 * length * data.velocity[i];
  }
  // None into another row.
  double way[kMaxRows];
  for (bool stopped = true; stopped;) {
    stopped = false;
    for (const RowGroup& c : rows.group) {
      if (!is_led(c)) continue;
      gather(rows, c, ahead_.data(), way);
      if (way[0] >= 0.0 || data.deformation[c.row] + way[0] > 0.0) continue;
      stopped = true;
      stop(c);
      for (int tree : c.tree)
        if (tree >= 0) stay(motion.trees().tree[tree], ahead_);
    }
  }
  for (const RowGroup& c : rows.group) {
    if (!is_led(c)) continue;
    gather(rows, c, ahead_.data(), way);
    data.deformation[c.row] += way[0];
  }
  for (size_t i = 0; i < ahead_.size(); ++i) {
    data.shift[i] += ahead_[i];
    data.total_displacement[i] += ahead_[i];
  }
}

bool Leapfrog::is_led(const RowGroup& c) const {
  if (c.kind == RowKind::kSlider) return false;
  return std::any_of(c.tree.begin(), c.tree.end(),
                     [&](int tree) { return tree >= 0 && leads_[tree]; });
}

void Leapfrog::stop(const RowGroup& c) {
  for (int tree : c.tree)
    if (tree >= 0) leads_[tree] = 0;
}

void Leapfrog::keep(double length, const std::vector<char>& held, const TreeMotion& motion,
                    Memory& memory) const {
  double* leading_length = memory.leading_length();
  if (!leading_length) return;
  for (int index = 0; index < motion.tree_count(); ++index) {
    const bool leads = !leapfrogs_.empty() && leapfrogs_[index] &&
                       (held[index] ? leads_[index] : !in_time_[index] || may_lead_[index]);
    leading_length[index] = leads ? length : 0.0;
  }
}

}  // namespace dashpot
