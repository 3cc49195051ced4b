#include "dashpot/integrate/coupled_energy.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/model/trees.hpp"

namespace dashpot {

namespace {

// s differs from 1 by some H times the rate of the motion where the step resolves it.
constexpr double kScaleRange = 0.5;
// Fraction of the kinetic energy that s at an end of its range may leave: at turning points
// energies do not determine s, and an impact leaves far more.
constexpr double kResidual = 1e-6;
// Verlet corrector, as a fraction of the velocity, up to which steps resolve how a motion turns
// that only contacts and limits hold. Beyond, it throws light links about, faster from hit to hit.
constexpr double kLargestHalf = 0.1;
// Fraction of the velocity, most that may be added where no s conserves energy: impacts lose or
// gain so much by chance. Motion that loses more is not resolved by steps, and may gain it in turn.
constexpr double kBoost = 0.03;
// Fraction of the velocity that smooth motion of linkages may be off by after all of the Verlet
// corrector, a step before a dead centre at 0.1 rad a step. Impacts leave less by chance alone.
constexpr double kSmooth = 0.01;
// Verlet corrector, as a fraction of the velocity, up to which it is smooth. Near a change point,
// where all links line up, a whole one throws them about: with 0.1 a parallelogram loses up to
// twice as much there. With 0.017 a slider-crank at 0.3 rad a step loses half as much again.
constexpr double kSmoothHalf = 0.025;
// (omega H)^2 of springs up to which velocity Verlet is bounded.
constexpr double kResolved = 4.0;
// Fraction of the Verlet corrector that something else may bring than springs: what turns fast lets
// velocity Verlet gain energy. More of it is better than no Verlet corrector.
constexpr double kRest = 0.2, kRestWithoutRoot = 0.5;

// Fraction of the kinetic energy that is rounding where all of it is in a common translation.
constexpr double kRounding = 1e-12;

// Fraction of the terms of a rate up to which they cancel.
constexpr double kCancelled = 1e-9;

// Whether a row has no rate in a motion.
bool is_at_rest(const Rows& rows, const RowGroup& c, const std::vector<double>& motion) {
  double rate = 0.0, most = 0.0;
  for (int k = 0; k < c.columns[0] + c.columns[1]; ++k) {
    const double part = rows.value[c.value + k] * motion[rows.column[c.column + k]];
    rate += part;
    most = std::max(most, std::abs(part));
  }
  return std::abs(rate) <= kCancelled * most;
}

}  // namespace

CoupledEnergy CoupledEnergy::anew() const {
  CoupledEnergy same;
  same.turning_work = turning_work;
  same.by_equalities = by_equalities;
  same.follows_drives = follows_drives;
  return same;
}

bool CoupledEnergy::is_of_springs(double most_rest) const {
  return restoring > 0.0 && restoring <= kResolved * way &&
         rest <= most_rest * most_rest * 2.0 * square;
}

double CoupledEnergy::find_scale() const {
  if (is_of_springs(kRest)) return 1.0;
  const bool too_large = !by_equalities && half_inside() > kLargestHalf * kLargestHalf * inside();
  const double root = too_large ? 0.0 : find_root();
  return root == 0.0 && is_of_springs(kRestWithoutRoot) ? 1.0 : root;
}

double CoupledEnergy::energy_with(double s) const {
  return kinetic + s * (linear + damped_linear + s * (square + damped_square));
}

double CoupledEnergy::common_energy(double s) const {
  double energy = 0.0;
  for (const CommonMomentum& translation : common)
    energy += 0.5 * translation.mass * translation.velocity(s) * translation.velocity(s);
  return energy;
}

double CoupledEnergy::half_inside() const {
  double energy = square;
  for (const CommonMomentum& translation : common)
    if (translation.mass > 0.0)
      energy -= 0.5 * translation.of_half * translation.of_half / translation.mass;
  return energy;
}

double CoupledEnergy::find_root() const {
  const double first = linear + damped_linear, second = square + damped_square;
  const double root = std::sqrt(first * first - 4.0 * second * (kinetic - wanted));
  const double sum = first + std::copysign(root, first);  // without cancellation
  double nearest = 0.0;
  for (double s : {-0.5 * sum / second, -2.0 * (kinetic - wanted) / sum})
    if (std::abs(s - 1.0) < std::abs(nearest - 1.0)) nearest = s;
  const double s = std::clamp(nearest, 1.0 - kScaleRange, 1.0 + kScaleRange);
  const double residual = std::abs(energy_with(s) - wanted);
  return residual <= kResidual * kinetic ? s : 0.0;
}

void CoupledEnergy::correct_speed(bool on_ground) {
  const auto inside_with = [&](double s) { return energy_with(s) - common_energy(s); };
  const double rounding = kRounding * kinetic;
  if (inside_with(0.0) <= rounding || inside_with(1.0) <= rounding) return;
  const auto excess_with = [&](double s) {
    return 1.0 - std::sqrt(std::max(0.0, wanted - common_energy(s)) / inside_with(s));
  };
  const bool is_smooth = by_equalities && half_inside() <= kSmoothHalf * kSmoothHalf * inside() &&
                         std::abs(excess_with(1.0)) <= kSmooth;
  if (is_smooth) scale = 1.0;
  if (!on_ground) return;
  const double excess = excess_with(scale);
  const double most = is_smooth ? kSmooth : by_equalities ? 0.0 : kBoost;
  brake = excess < -most ? 0.0 : excess;
}

bool give_up_drives(std::vector<CoupledEnergy>& all) {
  bool again = false;
  for (CoupledEnergy& coupled : all) {
    if (!coupled.left_corrector || coupled.scale != 0.0) continue;
    if (!coupled.follows_drives || !coupled.drives_change) continue;
    coupled.follows_drives = false;
    again = true;
  }
  return again;
}

void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree) {
  first_tree.assign(trees, -1);
  for (bool changed = true; changed;) {
    changed = false;
    for (int index : rows.equality) {
      const RowGroup& c = rows.group[index];
      int first = c.tree[0];
      for (int tree : c.tree)
        if (tree >= 0 && first_tree[tree] >= 0) first = std::min(first, first_tree[tree]);
      for (int tree : c.tree) {
        if (tree < 0 || first_tree[tree] == first) continue;
        first_tree[tree] = first;
        changed = true;
      }
    }
  }
}

void CommonTranslations::find(const mjModel_* model, const mjData_* d, const Rows& rows,
                              const Trees& trees, const std::vector<int>& first_tree) {
  count_.assign(first_tree.size(), 0);
  candidates_.assign(first_tree.size(), {});
  for (int equality : rows.equality) {
    const RowGroup& c = rows.group[equality];
    const int first = first_tree[c.tree[0]];
    Candidates& of_first = candidates_[first];
    if (of_first.count < 0)
      of_first.count = host::translations(model, d, first, of_first.direction.data());
  }
  for (int i = 0; i < kDirections; ++i) find_common(i, model, d, rows, trees, first_tree);
}

void CommonTranslations::find_common(int direction, const mjModel_* model, const mjData_* d,
                                     const Rows& rows, const Trees& trees,
                                     const std::vector<int>& first_tree) {
  const auto has_it = [&](const Candidates& c) { return c.count > direction; };
  any_[direction] = false;
  if (std::none_of(candidates_.begin(), candidates_.end(), has_it)) return;
  is_common_.resize(first_tree.size());
  std::transform(candidates_.begin(), candidates_.end(), is_common_.begin(), has_it);
  std::vector<double>& motion = motion_[direction];
  motion.assign(trees.coordinates, 0.0);
  const auto is_common = [&](int first) { return first >= 0 && is_common_[first]; };
  for (size_t index = 0; index < first_tree.size(); ++index) {
    const int first = first_tree[index];
    if (is_common(first))
      is_common_[first] =
          host::add_translation(model, d, trees, static_cast<int>(index),
                                candidates_[first].direction.data() + 3 * direction, motion.data());
  }
  for (int equality : rows.equality) {
    const RowGroup& c = rows.group[equality];
    const int first = first_tree[c.tree[0]];
    if (is_common(first)) is_common_[first] = is_at_rest(rows, c, motion);
  }
  for (size_t index = 0; index < first_tree.size(); ++index) {
    const Tree& t = trees.tree[index];
    if (!is_common(first_tree[index])) std::fill_n(motion.begin() + t.begin, t.count, 0.0);
  }
  for (size_t first = 0; first < count_.size(); ++first) {
    count_[first] += is_common_[first];
    any_[direction] = any_[direction] || is_common_[first];
  }
}

}  // namespace dashpot
