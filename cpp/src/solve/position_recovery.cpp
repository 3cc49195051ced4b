#include "dashpot/solve/position_recovery.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands/islands.hpp"

namespace dashpot {

namespace {

constexpr double kSoftness = 0.01;  // of an equality's inverse mass, at least
// Coordinates of which factors never take long, and of more the work of factors, for each row, from
// which on iterations take less.
constexpr int kFewCoordinates = 128;
constexpr double kMostWork = 8000.0;
constexpr int kMaxIterations = 20;  // of conjugate gradients
// Of the squared residual, relative: a millionth of what recovers is left for the next step.
constexpr double kConverged = 1e-12;

}  // namespace

void RecoverySystem::reset(const Rows& rows, const Trees& trees, const Island& island, double reach,
                           double time, const RowData& data) {
  rows_ = &rows;
  trees_ = &trees;
  island_ = &island;
  group_.clear();
  target_.clear();
  softness_.clear();
  scale_.clear();
  held_row_.clear();
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double x = data.deformation[c.row];
    const bool bilateral = c.kind == RowKind::kBilateral;
    if (!bilateral && c.kind != RowKind::kSlider && x >= 0.0) continue;
    group_.push_back(index);
    const bool sticks = data.sticking[index];
    for (int row = c.row; row < c.row + c.dim; ++row) {
      const bool slips = !sticks && (row > c.row || c.kind == RowKind::kSlider);
      const double k = rows.stiffness[row];
      const double w = rows.inverse_mass[row];
      const double softness = bilateral
                                  ? std::max(kSoftness * w, rows.typical_inverse_mass[row] - w)
                                  : 1.0 / (k * time * time);
      const bool acts = !slips && k > 0.0 && w + softness > 0.0;
      softness_.push_back(acts ? softness : 0.0);
      scale_.push_back(acts ? 1.0 / (w + softness) : 0.0);
      if (acts) held_row_.push_back({index, row - c.row, softness});
      target_.push_back(0.0);
    }
    // Where the spring is deformed beyond the position there is nothing to recover.
    const double offset = data.unstressed[index];
    if (bilateral && offset * (x - offset) < 0.0)
      target_.back() = std::clamp(offset, -reach, reach);
  }
}

bool RecoverySystem::empty() const {
  return std::all_of(target_.begin(), target_.end(), [](double t) { return t == 0.0; });
}

void RecoverySystem::solve(std::vector<double>& displacement) {
  multiplier_.assign(target_.size(), 0.0);
  held_.reset(*rows_, *trees_, island_->tree.begin(), island_->tree.end(), held_row_);
  if (is_worth_factors())
    factorize_and_solve(displacement);
  else
    iterate(displacement);
}

// d' H d = d' J' e.
double RecoverySystem::square() const {
  double sum = 0.0;
  for (size_t i = 0; i < shift_.size(); ++i) sum += shift_[i] * multiplier_[i];
  return sum;
}

// Factors know of soft trees what moves each body alone.
bool RecoverySystem::is_worth_factors() const {
  return held_.size() <= kFewCoordinates ||
         (held_.work() <= kMostWork * target_.size() &&
          std::none_of(island_->tree.begin(), island_->tree.end(),
                       [&](int tree) { return trees_->is_soft(tree); }));
}

void RecoverySystem::factorize_and_solve(std::vector<double>& displacement) {
  clear(displacement);
  if (held_.factor()) {
    for (size_t i = 0; i < target_.size(); ++i)
      multiplier_[i] = scale_[i] > 0.0 ? target_[i] / softness_[i] : 0.0;
    scatter_all(multiplier_, impulse_);
    held_.solve(impulse_.data(), displacement.data());
  }  // else they wait
  project(displacement, shift_);
  for (size_t i = 0; i < shift_.size(); ++i)
    multiplier_[i] = scale_[i] > 0.0 ? (target_[i] - shift_[i]) / softness_[i] : 0.0;
}

void RecoverySystem::iterate(std::vector<double>& displacement) {
  const size_t n = target_.size();
  residual_ = target_;
  direction_.resize(n);
  double square = 0.0;
  for (size_t i = 0; i < n; ++i) {
    direction_[i] = scale_[i] * residual_[i];
    square += residual_[i] * direction_[i];
  }
  const double small = kConverged * square;
  for (int iteration = 0; iteration < kMaxIterations && square > small; ++iteration) {
    displace(direction_, displacement);
    project(displacement, image_);
    double curvature = 0.0;
    for (size_t i = 0; i < n; ++i) {
      image_[i] += softness_[i] * direction_[i];
      curvature += direction_[i] * image_[i];
    }
    if (!(curvature > 0.0)) break;
    const double alpha = square / curvature;
    double next = 0.0;
    for (size_t i = 0; i < n; ++i) {
      multiplier_[i] += alpha * direction_[i];
      residual_[i] -= alpha * image_[i];
      next += scale_[i] * residual_[i] * residual_[i];
    }
    for (size_t i = 0; i < n; ++i)
      direction_[i] = scale_[i] * residual_[i] + next / square * direction_[i];
    square = next;
  }
  displace(multiplier_, displacement);
  project(displacement, shift_);
}

void RecoverySystem::project(const std::vector<double>& displacement,
                             std::vector<double>& out) const {
  out.resize(target_.size());
  double* of_group = out.data();
  for (int index : group_) {
    const RowGroup& c = rows_->group[index];
    gather(*rows_, c, displacement.data(), of_group);
    of_group += c.dim;
  }
}

// displacement = inv(H) J' multiplier.
void RecoverySystem::displace(const std::vector<double>& multiplier,
                              std::vector<double>& displacement) {
  clear(displacement);
  scatter_all(multiplier, impulse_);
  for (int index : island_->tree) {
    const Tree& t = trees_->tree[index];
    add_response(*trees_, index, impulse_.data() + t.begin, displacement.data() + t.begin);
  }
}

// impulse = J' multiplier.
void RecoverySystem::scatter_all(const std::vector<double>& multiplier,
                                 std::vector<double>& impulse) const {
  clear(impulse);
  const double* of_group = multiplier.data();
  for (int index : group_) {
    const RowGroup& c = rows_->group[index];
    scatter(*rows_, c, of_group, impulse.data());
    of_group += c.dim;
  }
}

// Zero over the trees of the island.
void RecoverySystem::clear(std::vector<double>& motion) const {
  motion.resize(trees_->coordinates);
  for (int index : island_->tree) {
    const Tree& t = trees_->tree[index];
    std::fill_n(motion.begin() + t.begin, t.count, 0.0);
  }
}

double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement) {
  if (std::none_of(island.group.begin(), island.group.end(), [&](int index) {
        return rows.group[index].kind == RowKind::kBilateral && data.unstressed[index] != 0.0;
      }))
    return 0.0;
  thread_local RecoverySystem system;  // kept by the thread: no allocation in a step
  system.reset(rows, trees, island, recovery_speed * time, time, data);
  if (system.empty()) return 0.0;
  system.solve(displacement);
  const std::vector<double>& shift = system.shift();

  // What all springs follow, beyond what equalities recover.
  double strain_energy = 0.0;
  const auto beyond = [&](size_t i, double part) {
    const double target = system.target()[i], along = part * shift[i];
    return along - std::clamp(along, std::min(0.0, target), std::max(0.0, target));
  };
  const auto for_each_row = [&](const auto& function) {
    size_t i = 0;
    for (int index : system.groups()) {
      const RowGroup& c = rows.group[index];
      for (int row = c.row; row < c.row + c.dim; ++row) function(row, i++);
    }
  };
  for_each_row([&](int row, size_t i) {
    strain_energy += 0.5 * rows.stiffness[row] * std::pow(beyond(i, 1.0), 2);
  });
  // The strain may hold no more energy than bodies that move so far in this step, which leaves
  // less than the whole displacement where the iteration has not converged.
  const double allowed = 0.5 * std::max(0.0, system.square()) / (time * time);
  const double part = strain_energy > allowed ? std::sqrt(allowed / strain_energy) : 1.0;
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) displacement[i] *= part;
  }

  const double before = elastic_energy(rows, data, system.groups());
  for_each_row([&](int row, size_t i) { data.deformation[row] += beyond(i, part); });
  for (int index : system.groups())
    if (rows.group[index].kind == RowKind::kBilateral) data.touched[index] = 1;
  return elastic_energy(rows, data, system.groups()) - before;
}

}  // namespace dashpot
