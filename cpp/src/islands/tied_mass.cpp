#include "dashpot/islands/tied_mass.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "dashpot/rows/hit.hpp"

namespace dashpot {

namespace {

constexpr int kMostGroups = 128;  // of an island whose hits are looked at
// Of the inverse masses of rows that hold: a hundredth of what a restitution shows.
constexpr double kCompliance = 1e-6;
// A rigid hit sinks in by some 1 / w_tied: with less, light feet would go through thin floors.
constexpr double kLeastTied = 0.01;
// How many times the load of smooth forces the spring of what is thrown back bears.
constexpr double kThrown = 1.25;
// Of what that load changes a speed by in a step: what is slower is at rest.
constexpr double kStill = 1e-3;

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

}  // namespace

void TiedMass::find(const StepView& step, const std::vector<GroupMaterial>& materials,
                    const Trees& trees, const std::vector<Island>& islands,
                    const std::vector<double>& compression, const RowData& data, Rows& rows) {
  if (rows.group.empty() || rows.group[0].kind == RowKind::kContact) return;
  for (const Island& island : islands) {
    if (island.group_count() > kMostGroups) continue;
    equality_.clear();
    limit_.clear();
    factored_.clear();
    responded_.clear();
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
    double speed = 0.0, fastest = 0.0, throws = 0.0, load = 0.0;
    bool fast = false;
    for (; at != scene.island.group.end() && rows.group[*at].first_of_pair == pair; ++at) {
      const RowGroup& c = rows.group[*at];
      const bool may_be_tied =
          c.kind == RowKind::kContact || (c.kind == RowKind::kUnilateral && !equality_.empty());
      if (!may_be_tied || rows.inverse_mass[c.row] == 0.0) continue;
      if (scene.compression[*at] == 0.0 || scene.materials[*at].from_solref) continue;
      hit_.push_back(*at);
      const double rate = std::abs(first_rate(rows, c, scene.data.velocity));
      fast = fast || rate > hit_speed(rows, c);
      fastest = std::max(fastest, rate);
      speed += scene.compression[*at] * rate;
    }
    for (int index : hit_) {
      if (fast) break;
      const RowGroup& c = rows.group[index];
      const double force = rows.inverse_mass[c.row] * remembered_force(scene.step, c, index);
      if (length * force > hit_speed(rows, c)) throws = std::max(throws, force);
      load = std::max(load, std::abs(first_rate(rows, c, scene.data.smooth_acceleration)));
    }
    if (!fast && (throws <= kThrown * load || fastest < kStill * length * load)) continue;
    const double ratio = tied(scene, rows, speed);
    if (!fast && throws * ratio <= kThrown * load) continue;
    for (int index : hit_) rows.group[index].tied = ratio;
  }
}

// Limits hold what a contact hits where they push, or its impulse closes them within the step.
double TiedMass::tied(const Scene& scene, const Rows& rows, double speed) {
  held_ = equality_;
  const bool by_limits = !limit_.empty() && rows.group[hit_[0]].kind == RowKind::kContact;
  if (held_.empty() && !by_limits) return 1.0;
  push(scene, rows);
  const double free = work_of_push(scene);
  if (!(free > 0.0)) return 1.0;
  for (int index : limit_) {
    if (!by_limits) break;
    const RowGroup& limit = rows.group[index];
    const double change = first_rate(rows, limit, response_) * speed / free;
    const double gap = scene.step.constraints[limit.input].position;
    const double rate = first_rate(rows, limit, scene.data.velocity);
    if (change < 0.0 && gap + scene.step.length * (rate + change) < 0.0) held_.push_back(index);
  }
  while (!held_.empty() && hold(scene, rows)) {
    const auto pulls = [&](int index) {
      const RowGroup& c = rows.group[index];
      return c.kind == RowKind::kUnilateral && first_rate(rows, c, response_) > 0.0;
    };
    const auto kept = std::remove_if(held_.begin(), held_.end(), pulls);
    if (kept == held_.end()) return std::clamp(work_of_push(scene) / free, kLeastTied, 1.0);
    held_.erase(kept, held_.end());
  }
  return 1.0;
}

// Finds what the push of a hit changes the velocities of the island by, as its rows see it.
void TiedMass::push(const Scene& scene, const Rows& rows) {
  clear(scene, force_);
  for (int index : hit_)
    scatter(rows, rows.group[index], 1, &scene.compression[index], force_.data());
  respond(scene, force_, pushed_);
  clear(scene, response_);
  for (int tree : scene.island.tree) {
    const Tree& t = scene.trees.tree[tree];
    std::copy_n(pushed_.begin() + t.begin, t.count, response_.begin() + t.begin);
  }
}

// Zero over the ground and the trees of the island.
void TiedMass::clear(const Scene& scene, AlignedDoubles& values) const {
  values.resize(scene.trees.coordinates);
  std::fill_n(values.begin(), kGroundCoordinates, 0.0);
  for (int tree : scene.island.tree) {
    const Tree& t = scene.trees.tree[tree];
    std::fill_n(values.begin() + t.begin, t.count, 0.0);
  }
}

// response = inv(H) force, over the trees of the island.
void TiedMass::respond(const Scene& scene, const AlignedDoubles& force,
                       AlignedDoubles& response) const {
  const Trees& trees = scene.trees;
  clear(scene, response);
  for (int tree : scene.island.tree) {
    const Tree& t = trees.tree[tree];
    if (!trees.sparse[tree]) {
      add_response(trees, tree, force.data() + t.begin, response.data() + t.begin);
      continue;
    }
    std::copy_n(force.begin() + t.begin, t.count, response.begin() + t.begin);
    solve_inertia(trees, tree, trees.factor.data() + t.inverse, response.data() + t.begin);
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

// Finds what the push changes velocities by where rows hold; false if that is beyond rounding.
bool TiedMass::hold(const Scene& scene, const Rows& rows) {
  if (held_.size() <= kFewHeld) return hold_with_few(scene, rows);
  if (held_ != factored_) {
    held_row_.clear();
    for (int index : held_)
      if (const double w = rows.bounded_inverse_mass(rows.group[index].row); w > 0.0)
        held_row_.push_back({index, 0, kCompliance * w});
    inertia_.reset(rows, scene.trees, scene.island.tree.begin(), scene.island.tree.end(),
                   held_row_);
    factored_ = held_;
    if (!inertia_.factor()) factored_.clear();
  }
  if (factored_.empty()) return false;
  inertia_.solve(force_.data(), response_.data());
  return true;
}

// What a unit impulse of each row that holds changes velocities by; hits ask for many again.
std::array<const AlignedDoubles*, TiedMass::kFewHeld> TiedMass::respond_to_held(const Scene& scene,
                                                                                const Rows& rows) {
  const auto place = [&](int index) {
    return std::find(responded_.begin(), responded_.end(), index) - responded_.begin();
  };
  const auto is_new = [&](int index) {
    return place(index) == static_cast<std::ptrdiff_t>(responded_.size());
  };
  if (responded_.size() + std::count_if(held_.begin(), held_.end(), is_new) > kFewHeld)
    responded_.clear();
  std::array<const AlignedDoubles*, kFewHeld> response{};
  for (size_t i = 0; i < held_.size(); ++i) {
    const auto at = place(held_[i]);
    if (is_new(held_[i])) {
      responded_.push_back(held_[i]);
      const double unit = 1.0;
      clear(scene, row_force_);
      scatter(rows, rows.group[held_[i]], 1, &unit, row_force_.data());
      respond(scene, row_force_, row_response_[at]);
    }
    response[i] = &row_response_[at];
  }
  return response;
}

bool TiedMass::hold_with_few(const Scene& scene, const Rows& rows) {
  const int count = static_cast<int>(held_.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kFewHeld, kFewHeld> mass(count, count);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kFewHeld, 1> impulse(count);
  const std::array<const AlignedDoubles*, kFewHeld> response = respond_to_held(scene, rows);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j <= i; ++j)
      mass(i, j) = mass(j, i) = first_rate(rows, rows.group[held_[j]], *response[i]);
    mass(i, i) *= 1.0 + kCompliance;
    impulse[i] = first_rate(rows, rows.group[held_[i]], pushed_);
  }
  const auto factors = mass.llt();
  if (factors.info() != Eigen::Success) return false;
  factors.solveInPlace(impulse);
  for (int tree : scene.island.tree) {
    const Tree& t = scene.trees.tree[tree];
    for (int k = t.begin; k < t.begin + t.count; ++k) {
      response_[k] = pushed_[k];
      for (int i = 0; i < count; ++i) response_[k] -= impulse[i] * (*response[i])[k];
    }
  }
  return true;
}

}  // namespace dashpot
