#include "dashpot/islands/tied_mass.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "dashpot/rows/hit.hpp"

namespace dashpot {

namespace {

constexpr int kMostGroups = 128;     // of an island whose hits are looked at
constexpr int kMostSteps = 24;       // of conjugate gradients: four welds in a row are exact
constexpr double kConverged = 1e-6;  // of the rates, a hundredth of what a restitution shows
// A rigid hit sinks in by some 1 / w_tied: with less, light feet would go through thin floors.
constexpr double kLeastTied = 0.01;
// How many times the load of smooth forces the spring of what is thrown back bears.
constexpr double kThrown = 1.25;

double rate_of(const Rows& rows, const RowGroup& c, const double* motion) {
  double rate;
  gather(rows, c.normal(), motion, &rate);
  return rate;
}

// That which a contact or limit bore at the end of the last step, N or N m.
double remembered_force(const StepView& step, const RowGroup& c, int index) {
  if (c.kind == RowKind::kUnilateral) {
    const RememberedConstraint before = step.memory.constraint(step.constraints[c.input].memory);
    return std::max(0.0, -before.stiffness * before.deformation);
  }
  if (step.matches[index].nearest < 0) return 0.0;
  const RememberedContact before = step.memory.contact(step.matches[index].nearest);
  return before.stiffness * before.compression;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

}  // namespace

void TiedMass::find(const StepView& step, const std::vector<GroupMaterial>& materials,
                    const Trees& trees, const std::vector<Island>& islands,
                    const std::vector<double>& compression, const RowData& data, Rows& rows) {
  if (rows.group.empty() || rows.group[0].kind == RowKind::kContact) return;
  force_.resize(trees.coordinates);
  response_.resize(trees.coordinates);
  std::fill_n(response_.begin(), kGroundCoordinates, 0.0);
  for (const Island& island : islands) {
    if (island.group_count() > kMostGroups) continue;
    equality_.clear();
    limit_.clear();
    for (int index : island.group) {
      const RowKind kind = rows.group[index].kind;
      if (kind == RowKind::kBilateral && materials[index].is_rigid()) equality_.push_back(index);
      if (kind == RowKind::kUnilateral) limit_.push_back(index);
    }
    if (!equality_.empty() || !limit_.empty())
      find_in({step, materials, trees, island, compression, data}, rows);
  }
}

void TiedMass::find_in(const Scene& scene, Rows& rows) {
  const double length = scene.step.length;
  for (const int* at = scene.island.group.begin(); at != scene.island.group.end();) {
    const int pair = rows.group[*at].first_of_pair;
    hit_.clear();
    weight_.clear();
    double speed = 0.0, throws = 0.0, load = 0.0;
    bool fast = false;
    for (; at != scene.island.group.end() && rows.group[*at].first_of_pair == pair; ++at) {
      const RowGroup& c = rows.group[*at];
      const double w = rows.inverse_mass[c.row];
      if (!c.is_unilateral() || w == 0.0 || scene.compression[*at] == 0.0) continue;
      if (scene.materials[*at].from_solref) continue;
      hit_.push_back(*at);
      weight_.push_back(scene.compression[*at]);
      const double rate = std::abs(rate_of(rows, c, scene.data.velocity.data()));
      fast = fast || rate > hit_speed(rows, c);
      speed += weight_.back() * rate;
      const double force = w * remembered_force(scene.step, c, *at);
      if (length * force > hit_speed(rows, c)) throws = std::max(throws, force);
      load = std::max(load, std::abs(rate_of(rows, c, scene.data.smooth_acceleration.data())));
    }
    if (hit_.empty() || !(fast || throws > kThrown * load)) continue;
    const double ratio = tied(scene, rows, speed);
    if (!fast && throws * ratio <= kThrown * load) continue;
    for (int index : hit_) rows.group[index].tied = ratio;
  }
}

// Limits hold what a contact hits where the impulse that stops it closes them within the step, and
// where they push.
double TiedMass::tied(const Scene& scene, const Rows& rows, double speed) {
  push(scene, rows, hit_, weight_);
  const double free = work_of_push(scene);
  if (!(free > 0.0)) return 1.0;
  held_ = equality_;
  const bool by_limits = rows.group[hit_[0]].kind == RowKind::kContact;
  for (int index : limit_) {
    if (!by_limits) break;
    const RowGroup& limit = rows.group[index];
    const double change = rate_of(rows, limit, response_.data()) * speed / free;
    const double gap = scene.step.constraints[limit.input].position;
    const double rate = rate_of(rows, limit, scene.data.velocity.data());
    if (change < 0.0 && gap + scene.step.length * (rate + change) < 0.0) held_.push_back(index);
  }
  rate_.clear();
  for (int index : held_) rate_.push_back(rate_of(rows, rows.group[index], response_.data()));
  while (!held_.empty()) {
    const double taken = solve(scene, rows);
    size_t kept = 0;
    for (size_t i = 0; i < held_.size(); ++i) {
      if (rows.group[held_[i]].kind == RowKind::kUnilateral && impulse_[i] > 0.0) continue;
      held_[kept] = held_[i];
      rate_[kept++] = rate_[i];
    }
    if (kept == held_.size()) return std::clamp(1.0 - taken / free, kLeastTied, 1.0);
    held_.resize(kept);
    rate_.resize(kept);
  }
  return 1.0;
}

// Finds what impulses on groups change the velocities of the island by.
void TiedMass::push(const Scene& scene, const Rows& rows, const std::vector<int>& groups,
                    const std::vector<double>& impulse) {
  const Trees& trees = scene.trees;
  std::fill_n(force_.begin(), kGroundCoordinates, 0.0);
  for (int tree : scene.island.tree) {
    const Tree& t = trees.tree[tree];
    std::fill_n(force_.begin() + t.begin, t.count, 0.0);
    std::fill_n(response_.begin() + t.begin, t.count, 0.0);
  }
  for (size_t i = 0; i < groups.size(); ++i)
    scatter(rows, rows.group[groups[i]].normal(), &impulse[i], force_.data());
  for (int tree : scene.island.tree) {
    const Tree& t = trees.tree[tree];
    add_response(trees, tree, force_.data() + t.begin, response_.data() + t.begin);
  }
}

double TiedMass::work_of_push(const Scene& scene) const {
  double work = 0.0;
  for (int tree : scene.island.tree) {
    const Tree& t = scene.trees.tree[tree];
    for (int i = t.begin; i < t.begin + t.count; ++i) work += force_[i] * response_[i];
  }
  return work;
}

// Solves for the impulses that take back `rate_`; returns the product of both.
double TiedMass::solve(const Scene& scene, const Rows& rows) {
  const size_t count = held_.size();
  impulse_.assign(count, 0.0);
  residual_ = rate_;
  scaled_.resize(count);
  const auto scale = [&] {
    for (size_t i = 0; i < count; ++i)
      scaled_[i] = residual_[i] / rows.bounded_inverse_mass(rows.group[held_[i]].row);
    return dot(residual_, scaled_);
  };
  double square = scale();
  direction_ = scaled_;
  const double enough = kConverged * kConverged * square;
  for (int step = 0; step < kMostSteps && square > enough; ++step) {
    push(scene, rows, held_, direction_);
    image_.clear();
    for (int index : held_) image_.push_back(rate_of(rows, rows.group[index], response_.data()));
    const double curvature = dot(direction_, image_);
    if (!(curvature > 0.0)) break;
    const double length = square / curvature;
    for (size_t i = 0; i < count; ++i) {
      impulse_[i] += length * direction_[i];
      residual_[i] -= length * image_[i];
    }
    const double next = scale();
    for (size_t i = 0; i < count; ++i) direction_[i] = scaled_[i] + next / square * direction_[i];
    square = next;
  }
  return dot(rate_, impulse_);
}

}  // namespace dashpot
