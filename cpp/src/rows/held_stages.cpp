#include "dashpot/rows/held_stages.hpp"

#include <algorithm>

namespace dashpot {

void HeldStages::find(const Rows& rows, const RowData& data, const Trees& trees,
                      const AlignedDoubles& start, const double* added,
                      const std::vector<char>& moved, double length) {
  trees_ = &trees;
  length_ = length;
  rows_.find_at_end(rows, data, trees, length);
  mean_acceleration_.assign(trees.above.size(), 0.0);
  way_.assign(mean_acceleration_.size(), 0.0);
  find_landed(rows, data);
  find_mean_springs(data, moved);
  for (int index = 0; index < static_cast<int>(trees.tree.size()); ++index) {
    if (!hold(index)) continue;
    const Tree& tree = trees.tree[index];
    double* way = way_.data() + tree.dof_begin;
    for (int i = 0; i < tree.dof_count; ++i) {
      const int k = tree.begin + i;
      const double before = start[k] + (added ? added[k] : 0.0);
      mean_acceleration_[tree.dof_begin + i] = (data.velocity[k] - before) / length;
      way[i] = data.total_displacement[k] - 0.5 * length * (before + data.velocity[k]);
    }
    if (lands_[index]) {
      std::fill_n(way, tree.dof_count, 0.0);
      continue;
    }
    change_.assign(tree.count, 0.0);
    std::copy_n(way, tree.dof_count, change_.begin());
    rows_.bar(trees, index, change_.data(), 0.0);
    for (int i = 0; i < tree.dof_count; ++i) way[i] -= change_[i];
  }
}

void HeldStages::find_landed(const Rows& rows, const RowData& data) {
  lands_.assign(trees_->tree.size(), 0);
  for (const RowGroup& c : rows.group) {
    if (!c.is_unilateral() || data.deformation[c.row] >= 0.0) continue;
    double way[kMaxRows];
    gather(rows, c, data.total_displacement.data(), way);
    if (data.deformation[c.row] - way[0] < 0.0) continue;
    for (int tree : c.tree)
      if (tree >= 0) lands_[tree] = 1;
  }
}

void HeldStages::find_mean_springs(const RowData& data, const std::vector<char>& moved) {
  have_springs_ = false;
  springs_.assign(trees_->tree.size(), 0);
  for (size_t index = 0; index < trees_->tree.size(); ++index) {
    const Tree& t = trees_->tree[index];
    if (!t.sprung || !moved[index]) continue;
    springs_[index] = 1;
    if (!have_springs_)
      for (auto* array : {&mean_pull_, &stiffness_}) array->assign(trees_->above.size(), 0.0);
    have_springs_ = true;
    for (int i = 0; i < t.dof_count; ++i) {
      const int dof = t.dof_begin + i, k = t.begin + i;
      mean_pull_[dof] = data.pulled[k] / length_;
      stiffness_[dof] = trees_->stiffness[k];
    }
  }
}

void HeldStages::bar(std::vector<double>& acceleration, double weight) {
  for (size_t index = 0; index < trees_->tree.size(); ++index) {
    const int tree = static_cast<int>(index);
    if (!hold(tree)) continue;
    const Tree& t = trees_->tree[index];
    double* own = acceleration.data() + t.dof_begin;
    const double* mean = mean_acceleration_.data() + t.dof_begin;
    change_.assign(t.count, 0.0);
    for (int i = 0; i < t.dof_count; ++i) change_[i] = own[i] - mean[i];
    rows_.bar(*trees_, tree, change_.data(), weight);
    for (int i = 0; i < t.dof_count; ++i) own[i] = mean[i] + change_[i];
  }
}

}  // namespace dashpot
