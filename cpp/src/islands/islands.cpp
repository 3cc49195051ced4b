#include "dashpot/islands/islands.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/rows/hit.hpp"

namespace dashpot {

namespace {

// Least share of the resolution of damping that friction takes from normals.
constexpr double kFrictionShare = 0.5;
// Of groups and of trees, how many a thread takes at once.
constexpr int kGroupsAtOnce = 64, kTreesAtOnce = 16;

// (a + b)^2 <= (1 + s) a^2 + (1 + 1/s) b^2 splits the bound of all rows between normals, which have
// the bound `normal` (0: nothing to split), and friction, where that is the better one for normals:
// s is what critical damping of the stiffest normals leaves to friction,
// 2 sqrt(kappa) h ((1 + s) c_n - 1) = theta, at least kFrictionShare.
RigidCoupling split_coupling(double all, double normal) {
  if (normal == 0.0) return {all, all, all};
  const double resolved = 1.0 + kRigidResolution / (2.0 * std::sqrt(stiffest_rigid(all)));
  const double share = std::max(kFrictionShare, resolved / normal - 1.0);
  if ((1.0 + share) * normal >= all) return {all, all, all};
  return {all, (1.0 + share) * normal, (1.0 + 1.0 / share) * all};
}

// Weight of a row in its two trees, k (1 + sqrt(w_other / w)), without k; 0 in one that it does
// not move.
std::array<double, 2> split_between_trees(const std::array<double, 2>& inverse_mass) {
  const auto [w0, w1] = inverse_mass;
  const double ratio = w0 > 0.0 && w1 > 0.0 ? std::sqrt(w1 / w0) : 0.0;
  return {w0 > 0.0 ? 1.0 + ratio : 0.0, w1 > 0.0 ? 1.0 + (ratio > 0.0 ? 1.0 / ratio : 0.0) : 0.0};
}

// Whether a rigid contact or limit is hit. A model's own solref is resolved unless it is
// stiffer than rigid.
bool is_hit(const Island& island, const std::vector<GroupMaterial>& materials,
            const std::vector<Hit>& hits) {
  return std::any_of(island.group.begin(), island.group.end(), [&](int index) {
    const GroupMaterial& given = materials[index];
    return hits[index] != Hit::kNone && given.is_rigid();
  });
}

// The last bit of a quotient must not add a micro-step.
int rounded_up(double count) {
  return static_cast<int>(std::ceil(count * (1.0 - kRoundingOfBounds)));
}

}  // namespace

bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data) {
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (!c.is_unilateral() || data.deformation[c.row] <= 0.0) return false;
  }
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double gap = data.deformation[c.row];
    double rate = first_rate(rows, c, data.velocity);
    double load = first_rate(rows, c, data.smooth_acceleration);
    if (c.is_of_round_hit) {
      rate -= c.turning[0] * c.ahead;
      load += c.turning[0];
    }
    // The parabola's least value within the time: at an end, or where it turns.
    const double end = gap + time * (rate + 0.5 * load * time);
    const bool turns = rate < 0.0 && rate + load * time > 0.0;
    const double least = turns ? gap - 0.5 * rate * rate / load : end;
    if (least <= 0.0) return false;
  }
  return true;
}

HitMicrosteps microsteps_of_hit(int of_step, const Options& options) {
  HitMicrosteps hit;
  hit.count = options.microsteps > 0
                  ? of_step
                  : std::min(kMicrostepsOfHits * of_step, options.max_microsteps);
  const double stiff_for = double(hit.count) / kMicrostepsOfHits;
  hit.stiff_for = std::min<double>(of_step, std::max(kFewestOfHits, stiff_for));
  return hit;
}

void Islands::plan(Rows& rows, const Trees& trees, const MicrostepDemand& demand, Team& team) {
  const std::vector<GroupMaterial>& materials = demand.materials;
  const std::vector<DeflectionTime>& deflection_time = demand.deflection_time;
  bounds_.assign(trees.tree.size(), TreeBounds{});
  for (CoupledSum* sum : {&stiffness_, &damping_, &rigid_normal_, &rigid_friction_})
    sum->reset(trees);
  room_.resize(team.size());
  for (CoupledSum::Room& room : room_) room.fit(trees);
  const int count = static_cast<int>(group_order_.size());
  split_.resize(rows.inverse_mass.size());
  team.for_each(count, kGroupsAtOnce, [&](int at) {
    const int index = group_order_[at];
    const RowGroup& c = rows.group[index];
    if (materials[index].has_si_stiffness()) fill_given_rows(rows, c, materials[index].material);
    for (int row = c.row; row < c.row + c.dim; ++row)
      split_[row] = split_between_trees(rows.tree_inverse_mass[row]);
  });
  const int* const all_trees = tree_order_.data();
  measure(all_trees, all_trees + tree_order_.size(), rows, trees, demand, false, team);
  if (demand.options.microsteps == 0) {
    rigid_longest_.assign(rows.group.size(), std::numeric_limits<double>::infinity());
    team.for_each(count, kGroupsAtOnce, [&](int at) {
      const int index = group_order_[at];
      const RowGroup& c = rows.group[index];
      if (!materials[index].has_si_stiffness())
        rigid_longest_[index] = dashpot::longest_rigid_microstep(
            rows, c, materials[index], rigid_coupling(c), deflection_time[c.first_of_pair]);
    });
  }
  resolves_.resize(islands_.size());
  for (size_t i = 0; i < islands_.size(); ++i) {
    Island& island = islands_[i];
    const double si_microstep = longest_si_microstep(island);
    const bool enough_for_friction = choose_microsteps(island, demand);
    resolves_[i] = fits(island.duration, si_microstep);
    if (!resolves_[i])
      measure(island.tree.first, island.tree.last, rows, trees, demand, true, team);
    if (!enough_for_friction) continue;
    for (int tree : island.tree) {  // nothing is taken from normals for it
      RigidCoupling& own = bounds_[tree].coupling;
      own = {own.stiffness, own.stiffness, own.stiffness};
    }
  }
  lowered_.resize(count);
  team.for_each(count, kGroupsAtOnce, [&](int at) {
    const int index = group_order_[at];
    const RowGroup& c = rows.group[index];
    const Island& island = islands_[island_at_[at]];
    lowered_[at] = false;
    if (resolves_[island_at_[at]] && materials[index].has_si_stiffness()) return;
    lowered_[at] = !fill_rigid_rows(rows, c, materials[index], rigid_coupling(c),
                                    deflection_time[c.first_of_pair],
                                    {island.duration, island.rigid_duration, island.hit});
  });
  for (int at = 0; at < count; ++at)
    if (lowered_[at]) islands_[island_at_[at]].clipped += rows.group[group_order_[at]].dim;
}

bool Islands::choose_microsteps(Island& island, const MicrostepDemand& demand) {
  const Options& options = demand.options;
  const double part = demand.part, step = demand.step;
  double count = options.microsteps;
  if (options.microsteps == 0) {
    const double longest = std::min(longest_si_microstep(island), longest_rigid_microstep(island));
    count = std::max<double>(kMinimumMicrosteps, step / longest);
  }
  const int of_step = rounded_up(std::min<double>(count, options.max_microsteps));
  island.rigid_duration = step / of_step;
  island.microsteps = part == step ? of_step : rounded_up(part / island.rigid_duration);
  island.hit = is_hit(island, demand.materials, demand.data.hit);
  bool enough_for_friction = false;
  if (island.hit) {
    HitMicrosteps of_hit = microsteps_of_hit(of_step, options);
    // What rests on others would sink in.
    if (!demand.data.is_of_isolated_pair[*island.group.first]) of_hit.stiff_for = of_step;
    island.rigid_duration = step / of_hit.stiff_for;
    island.microsteps = part == step ? of_hit.count : rounded_up(part / step * of_hit.count);
    enough_for_friction = of_hit.count >= 2.0 * of_hit.stiff_for;
  }
  island.duration = part / island.microsteps;
  return enough_for_friction;
}

void Islands::measure(const int* first_tree, const int* last_tree, const Rows& rows,
                      const Trees& trees, const MicrostepDemand& demand, bool all_rigid,
                      Team& team) {
  team.share(static_cast<int>(last_tree - first_tree), kTreesAtOnce,
             [&](int worker, int first, int last) {
               for (int i = first; i < last; ++i) {
                 add_sides(first_tree[i], rows, trees, demand, all_rigid);
                 take_bounds(first_tree[i], trees, room_[worker]);
               }
             });
}

void Islands::add_sides(int tree, const Rows& rows, const Trees& trees,
                        const MicrostepDemand& demand, bool all_rigid) {
  for (int at = first_side_[tree]; at < first_side_[tree + 1]; ++at) {
    const int index = side_order_[at] / 2, side = side_order_[at] % 2;
    const bool is_given = demand.materials[index].has_si_stiffness() && !all_rigid;
    if (demand.stays_open[index] && !is_given) continue;
    const RowGroup& c = rows.group[index];
    double weight[kMaxRows];
    const auto weigh = [&](const double* of_row) {
      for (int i = 0; i < c.dim; ++i) weight[i] = split_[c.row + i][side] * of_row[i];
    };
    if (!is_given) {
      double unit[kMaxRows];
      for (int i = 0; i < c.dim; ++i) {
        // No less than 1 / w, so that what is left of the bound without 1 is all coupling.
        double w = rows.inverse_mass[c.row + i];
        if (i == 0 && c.pair_inverse_mass > 0.0) w = std::min(w, c.pair_inverse_mass);
        unit[i] = w > 0.0 ? 1.0 / w : 0.0;
      }
      weigh(unit);
      CoupledSum::add_contact(rows, trees, c, side, weight, rigid_normal_, rigid_friction_);
    } else {
      weigh(rows.stiffness.data() + c.row);
      stiffness_.add(rows, trees, c, side, 0, c.dim, weight);
      weigh(rows.damping.data() + c.row);
      damping_.add(rows, trees, c, side, 0, c.dim, weight);
    }
  }
}

void Islands::take_bounds(int tree, const Trees& trees, CoupledSum::Room& room) {
  TreeBounds& b = bounds_[tree];
  b.stiffness = stiffness_.take_bound(trees, tree, room);
  b.damping = damping_.take_bound(trees, tree, room);
  if (rigid_friction_.empty(tree)) {
    b.rigid = rigid_normal_.take_bound(trees, tree, room);
    const double all = b.rigid / b.rigid_share();
    b.coupling = {all, all, all};
    return;
  }
  const double normal = rigid_normal_.replace(trees, tree, rigid_friction_, room);
  b.rigid = rigid_friction_.take_bound(trees, tree, room);
  b.coupling = split_coupling(b.rigid / b.rigid_share(), normal / b.rigid_share());
}

// Longest micro-step that resolves every SI value.
double Islands::longest_si_microstep(const Island& island) const {
  double h = std::numeric_limits<double>::infinity();
  for (int tree : island.tree) {
    const TreeBounds& b = bounds_[tree];
    if (b.stiffness > 0.0) h = std::min(h, kResolution * std::sqrt(b.si_share() / b.stiffness));
    if (b.damping > 0.0) h = std::min(h, kResolution * b.si_share() / b.damping);
  }
  return h;
}

double Islands::longest_rigid_microstep(const Island& island) const {
  double h = std::numeric_limits<double>::infinity();
  for (int index : island.group) h = std::min(h, rigid_longest_[index]);
  return h;
}

RigidCoupling Islands::rigid_coupling(const RowGroup& c) const {
  RigidCoupling most;
  for (int tree : c.tree) {
    if (tree < 0) continue;
    const RigidCoupling& own = bounds_[tree].coupling;
    most.stiffness = std::max(most.stiffness, own.stiffness);
    most.normal_damping = std::max(most.normal_damping, own.normal_damping);
    most.friction_damping = std::max(most.friction_damping, own.friction_damping);
  }
  return most;
}

}  // namespace dashpot
