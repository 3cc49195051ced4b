#include "dashpot/position_recovery.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/islands.hpp"

namespace dashpot {

namespace {

constexpr int kMaxIterations = 20;  // of conjugate gradients; a loop of n rows takes n
// Of the squared residual, relative: a millionth of what recovers is left for the next step.
constexpr double kConverged = 1e-12;
constexpr double kSoftness = 0.01;  // of an equality's inverse mass, at least

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

// The system (A + R) e = t over the rows of an island whose springs act.
class RecoverySystem {
 public:
  void reset(const Rows& rows, const Trees& trees, const Island& island, double reach, double time,
             const RowData& data) {
    rows_ = &rows;
    trees_ = &trees;
    island_ = &island;
    group_.clear();
    target_.clear();
    softness_.clear();
    acts_.clear();
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
        softness_.push_back(bilateral ? std::max(kSoftness * w, rows.typical_inverse_mass[row] - w)
                                      : 1.0 / (k * time * time));
        acts_.push_back(!slips && k > 0.0);
        target_.push_back(0.0);
      }
      // Where the spring is deformed beyond the position there is nothing to recover.
      const double offset = data.offset[index];
      if (bilateral && offset * (x - offset) < 0.0)
        target_.back() = std::clamp(offset, -reach, reach);
    }
  }

  bool empty() const {
    return std::all_of(target_.begin(), target_.end(), [](double t) { return t == 0.0; });
  }
  const std::vector<int>& groups() const { return group_; }
  const std::vector<double>& target() const { return target_; }

  // displacement = inv(H) J' e by conjugate gradients.
  void solve(std::vector<double>& displacement) {
    const size_t n = target_.size();
    multiplier_.assign(n, 0.0);
    residual_ = direction_ = target_;
    image_.resize(n);
    double square = dot(residual_, residual_);
    const double small = kConverged * square;
    for (int i = 0; i < kMaxIterations && square > small; ++i) {
      displace(direction_, displacement);
      project(displacement, image_);
      for (size_t j = 0; j < n; ++j)
        image_[j] = acts_[j] ? image_[j] + softness_[j] * direction_[j] : 0.0;
      const double curvature = dot(direction_, image_);
      if (!(curvature > 0.0)) break;
      const double alpha = square / curvature;
      for (size_t j = 0; j < n; ++j) {
        multiplier_[j] += alpha * direction_[j];
        residual_[j] -= alpha * image_[j];
      }
      const double next = dot(residual_, residual_);
      for (size_t j = 0; j < n; ++j) direction_[j] = residual_[j] + next / square * direction_[j];
      square = next;
    }
    displace(multiplier_, displacement);
  }

  // d' H d of the solution.
  double square() const { return square_; }

  // What a displacement moves every row, J displacement.
  const std::vector<double>& shift(const std::vector<double>& displacement) {
    image_.resize(target_.size());
    project(displacement, image_);
    return image_;
  }

 private:
  void project(const std::vector<double>& displacement, std::vector<double>& out) const {
    double* of_group = out.data();
    for (int index : group_) {
      const RowGroup& c = rows_->group[index];
      gather(*rows_, c, displacement.data(), of_group);
      of_group += c.dim;
    }
  }

  // displacement = inv(H) J' multiplier.
  void displace(const std::vector<double>& multiplier, std::vector<double>& displacement) {
    impulse_.assign(displacement.size(), 0.0);
    const double* factor = multiplier.data();
    for (int index : group_) {
      const RowGroup& c = rows_->group[index];
      scatter(*rows_, c, factor, impulse_.data());
      factor += c.dim;
    }
    square_ = 0.0;
    for (int index : island_->tree) {
      const Tree& t = trees_->tree[index];
      std::fill_n(displacement.begin() + t.begin, t.count, 0.0);
      add_response(*trees_, index, impulse_.data() + t.begin, displacement.data() + t.begin);
      for (int i = t.begin; i < t.begin + t.count; ++i) square_ += displacement[i] * impulse_[i];
    }
  }

  const Rows* rows_ = nullptr;
  const Trees* trees_ = nullptr;
  const Island* island_ = nullptr;
  std::vector<int> group_;
  std::vector<double> target_, softness_;  // per row of these groups
  std::vector<char> acts_;
  std::vector<double> impulse_;  // J' multiplier
  std::vector<double> multiplier_, residual_, direction_, image_;
  double square_ = 0.0;
};

}  // namespace

double recover_positions(const Rows& rows, const Trees& trees, const Island& island,
                         double recovery_speed, double time, RowData& data,
                         std::vector<double>& displacement) {
  if (std::none_of(island.group.begin(), island.group.end(), [&](int index) {
        return rows.group[index].kind == RowKind::kBilateral && data.offset[index] != 0.0;
      }))
    return 0.0;
  thread_local RecoverySystem system;  // kept by the thread: no allocation in a step
  system.reset(rows, trees, island, recovery_speed * time, time, data);
  if (system.empty()) return 0.0;
  system.solve(displacement);
  const std::vector<double>& shift = system.shift(displacement);

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
  const double allowed = 0.5 * system.square() / (time * time);
  const double part = strain_energy > allowed ? std::sqrt(allowed / strain_energy) : 1.0;
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    for (int i = t.begin; i < t.begin + t.count; ++i) displacement[i] *= part;
  }

  const double before = elastic_energy(rows, data).sum();
  for_each_row([&](int row, size_t i) { data.deformation[row] += beyond(i, part); });
  for (int index : system.groups())
    if (rows.group[index].kind == RowKind::kBilateral) data.touched[index] = 1;
  return elastic_energy(rows, data).sum() - before;
}

}  // namespace dashpot
