#include "dashpot/impact.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "dashpot/geometry_host.hpp"
#include "dashpot/mujoco_properties.hpp"
#include "dashpot/mujoco_state.hpp"
#include "dashpot/mujoco_trees.hpp"
#include "dashpot/pair_motion.hpp"
#include "dashpot/query.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr double kTurn = 0.005;  // rad, in a part with contact
// A blow between round bodies that has begun fast goes on so: parts of another length end it as
// another blow. Factor on the step, by which its pair counts as fast.
constexpr double kGoesOn = 2.0;
constexpr double kShortest = 1e-6;  // of the rest of a step: parts shorter than this are not cut

struct FastPair : PairMotion {
  double margin = 0.0;   // m, distance at which contact starts
  bool apart = false;    // from each other, proven for this part
  double clear = 0.0;    // s, how long it is proven
  bool pressed = false;  // round, with compression remembered
};

class ImpactSearch {
 public:
  ImpactSearch(const mjModel_* model, const mjData_* data, const Memory& memory,
               const std::vector<double>& acceleration, double whole, double remaining)
      : model_(model),
        data_(data),
        whole_(whole),
        remaining_(remaining),
        velocity_(body_motions(model, data, host::velocity(data))),
        acceleration_(body_motions(model, data, acceleration.data())) {
    bound_.resize(host::geom_count(model));
    for (size_t geom = 0; geom < bound_.size(); ++geom)
      bound_[geom] = bound_geom(static_cast<int>(geom));
    read_loaded(memory);
  }

  // Finds the fast pairs among those that collision reports.
  void find_fast(const std::vector<ContactInput>& contacts) {
    pair_of_contact_.assign(contacts.size(), -1);
    for (size_t i = 0; i < contacts.size(); ++i) {
      const ContactInput& contact = contacts[i];
      const bool known =
          i > 0 && contacts[i - 1].geom == contact.geom && pair_of_contact_[i - 1] >= 0;
      if (!known) {
        if (is_slow(contact.geom)) continue;
        if (!has_shape(model_, contact.geom[0]) || !has_shape(model_, contact.geom[1])) continue;
        const FastPair pair = make_pair(contact);
        if (!is_fast(pair, contact)) continue;
        pairs_.push_back(pair);
      }
      const int index = static_cast<int>(pairs_.size()) - 1;
      for (size_t j = i + 1; j-- > 0 && contacts[j].geom == contact.geom;)
        pair_of_contact_[j] = index;
    }
  }
  bool any() const { return !pairs_.empty(); }
  // Undisturbed pairs that an earlier part has proven apart need no look before that time.
  void recall(const ProvenApart& proven) {
    for (FastPair& pair : pairs_)
      if (pair.flies) pair.clear = proven.time_left(pair.geoms(), remaining_);
  }
  void remember(ProvenApart& proven) const {
    for (const FastPair& pair : pairs_)
      if (pair.flies && pair.apart)
        proven.add(pair.geoms(), {pair.side[0].tree, pair.side[1].tree}, remaining_ - pair.clear);
  }

  // The motion over a shorter part is nearer to its mean: a second look at the pairs that limit the
  // part sharpens the first.
  double find_part(int cuts_left) {
    const double shortest_contact = remaining_ / (2.0 * cuts_left);
    double part = remaining_;
    const auto look = [&](FastPair& pair, double length) {
      part = std::min(part, examine(pair, length, shortest_contact));
    };
    for (FastPair& pair : pairs_) {
      pair.apart = pair.clear > 0.0;
      if (!pair.apart) look(pair, remaining_);
    }
    for (FastPair& pair : pairs_)
      if (pair.apart && pair.clear < part) look(pair, remaining_);
    const double length = part;
    for (FastPair& pair : pairs_)
      if (!pair.apart || pair.clear <= length) look(pair, length);
    part = std::max(part, kShortest * remaining_);
    return part > (1.0 - kShortest) * remaining_ ? remaining_ : part;
  }

  std::vector<GeomPair> pairs_in_touch() const {
    std::vector<GeomPair> touching;
    for (const FastPair& pair : pairs_)
      if (!pair.apart) touching.push_back(pair.geoms());
    std::sort(touching.begin(), touching.end());
    return touching;
  }

  // Pairs that fly apart of each other, undisturbed.
  std::vector<GeomPair> pairs_apart(const std::vector<ConstraintInput>& constraints,
                                    const std::vector<ContactInput>& contacts) const {
    std::vector<char> disturbed(host::tree_count(model_), 0);
    bool changed = false;
    const auto disturb = [&](int tree) {
      if (tree < 0 || disturbed[tree]) return;
      disturbed[tree] = 1;
      changed = true;
    };
    const auto is_disturbed = [&](int tree) { return tree >= 0 && disturbed[tree]; };
    for (const ConstraintInput& constraint : constraints)
      for (int tree : constraint.tree) disturb(tree);
    for (const FastPair& pair : pairs_)
      if (!pair.apart)
        for (const SideMotion& side : pair.side) disturb(side.tree);
    const auto drops = [&](const FastPair& pair) {
      return pair.apart && pair.flies && !is_disturbed(pair.side[0].tree) &&
             !is_disturbed(pair.side[1].tree);
    };
    // What an impact disturbs, it may hand on through any contact with rows.
    do {
      changed = false;
      for (size_t i = 0; i < contacts.size(); ++i) {
        const auto& tree = contacts[i].tree;
        const int index = pair_of_contact_[i];
        if (index >= 0 && drops(pairs_[index])) continue;
        if (!is_disturbed(tree[0]) && !is_disturbed(tree[1])) continue;
        for (int t : tree) disturb(t);
      }
    } while (changed);
    std::vector<GeomPair> apart;
    for (const FastPair& pair : pairs_)
      if (drops(pair)) apart.push_back(pair.geoms());
    std::sort(apart.begin(), apart.end());
    return apart;
  }

 private:
  // What bounds a geom's part in any pair.
  struct Bound {
    double half_width = 0.0;  // m
    double radius = 0.0;      // m, reach of the core about the body's centre of mass
    double speed = 0.0;       // m/s, of its points
    double calm_way = 0.0;    // m, relative motion in a step that asks for nothing
  };

  Bound bound_geom(int geom) const {
    const int body = geom_body(model_, geom);
    const GeomBounds size = geom_bounds(model_, geom);
    Bound bound;
    bound.half_width = size.half_width;
    if (std::isfinite(size.half_width))
      bound.radius = size.core_radius + geom_offset(data_, geom, velocity_[body].centre);
    bound.calm_way = kFastMotion * bound.half_width;
    // Of two, where it turns their normal as fast.
    if (size.is_round)
      bound.calm_way = std::min(bound.calm_way, 2.0 * kFastTurn * bound.half_width);
    if (bound.radius > 0.0 && host::geom_tree(model_, geom) >= 0)
      bound.calm_way = std::min(bound.calm_way, kFastTurn * bound.radius);
    const auto mean = [&](const Vector3d& velocity, const Vector3d& acceleration) {
      return (velocity + 0.5 * remaining_ * acceleration).norm();
    };
    bound.speed = mean(velocity_[body].linear, acceleration_[body].linear) +
                  mean(velocity_[body].angular, acceleration_[body].angular) * bound.radius;
    return bound;
  }

  double half_width(const GeomPair& geom) const {
    return std::min(bound_[geom[0]].half_width, bound_[geom[1]].half_width);
  }

  // Slow in any direction.
  bool is_slow(const GeomPair& geom) const {
    const double speed = bound_[geom[0]].speed + bound_[geom[1]].speed + release_speed(geom);
    return speed * kGoesOn * whole_ <= std::min(bound_[geom[0]].calm_way, bound_[geom[1]].calm_way);
  }

  // A pair whose compressed contacts hold enough to make it fast.
  struct Loaded {
    std::array<int, 2> geom;
    double speed_squared;
  };

  void read_loaded(const Memory& memory) {
    for (int i = 0; i < memory.contact_count(); ++i) {
      const RememberedContact contact = memory.contact(i);
      if (contact.compression <= 0.0) continue;
      const std::array<int, 2> geom = {int(contact.geom[0]), int(contact.geom[1])};
      pressed_.push_back(geom);
      double inverse_mass = 0.0;
      for (int g : geom) inverse_mass += host::geom_inverse_mass(model_, g);
      const double rate_squared = contact.stiffness * inverse_mass;
      const double speed_squared = rate_squared * contact.compression * contact.compression *
                                   std::min(1.0, rate_squared * whole_ * whole_);
      const double fast = kFastMotion * half_width(geom);
      if (speed_squared * whole_ * whole_ <= fast * fast) continue;
      if (loaded_.empty() || loaded_.back().geom != geom) loaded_.push_back({geom, 0.0});
      loaded_.back().speed_squared += speed_squared;
    }
  }

  double release_speed(const GeomPair& geom) const {
    double speed_squared = 0.0;
    for (const Loaded& loaded : loaded_)
      if (loaded.geom == geom) speed_squared += loaded.speed_squared;
    return std::sqrt(speed_squared);
  }

  bool is_free(int tree) const { return tree < 0 || host::is_free_body(model_, tree); }

  FastPair make_pair(const ContactInput& contact) const {
    FastPair pair;
    pair.margin = std::max(0.0, contact.margin);
    for (int i = 0; i < 2; ++i) {
      SideMotion& side = pair.side[i];
      side.geom = contact.geom[i];
      side.tree = contact.tree[i];
      const int body = geom_body(model_, side.geom);
      side.velocity = velocity_[body];
      side.acceleration = acceleration_[body];
      const GeomBounds size = geom_bounds(model_, side.geom);
      side.core_radius = size.core_radius;
      if (size.is_round) side.curvature_radius = size.half_width;
      if (size.is_revolution) side.symmetry = geom_pose(model_, data_, side.geom).rotation.col(2);
      if (std::isfinite(size.half_width))
        side.offset = geom_offset(data_, side.geom, side.velocity.centre);
      if (std::isinf(bound_[side.geom].half_width)) pair.has_plane = true;
    }
    pair.pressed = std::isfinite(pair.side[0].curvature_radius + pair.side[1].curvature_radius) &&
                   std::find(pressed_.begin(), pressed_.end(), contact.geom) != pressed_.end();
    pair.half_width = half_width(contact.geom);
    pair.release_speed = release_speed(contact.geom);
    pair.flies = is_free(pair.side[0].tree) && is_free(pair.side[1].tree);
    return pair;
  }

  bool is_fast(const FastPair& pair, const ContactInput& contact) const {
    const Vector3d normal(contact.frame[0], contact.frame[1], contact.frame[2]);
    const bool touches = contact.gap <= 2.0 * pair.standoff(remaining_);
    const double speed = pair.has_plane || touches ? pair.closing_speed(normal, remaining_)
                                                   : pair.closing_speed(remaining_);
    return pair.is_fast(speed + pair.release_speed, normal, remaining_, step_of(pair));
  }

  double step_of(const FastPair& pair) const { return pair.pressed ? kGoesOn * whole_ : whole_; }

  // How long the pair allows the part to last, at most `length`.
  double examine(FastPair& pair, double length, double shortest_contact) const {
    Shape shape[2];
    Pose pose[2];
    Motion motion[2];
    for (int i = 0; i < 2; ++i) {
      const SideMotion& side = pair.side[i];
      shape[i] = geom_shape(model_, side.geom);
      pose[i] = geom_pose(model_, data_, side.geom);
      motion[i] = side.mean_motion(length, is_free(side.tree));
      if (shape[i].type == ShapeType::kPlane && !motion[i].angular.isZero(0.0)) return length;
    }
    const double standoff = pair.standoff(length);
    const Distance now = distance(shape[0], pose[0], shape[1], pose[1]);
    pair.apart = now.distance - pair.margin > 2.0 * standoff;
    if (pair.apart) {
      try {
        pair.clear = time_of_impact(shape[0], pose[0], motion[0], shape[1], pose[1], motion[1],
                                    length, pair.margin + standoff)
                         .time;
        return pair.clear;
      } catch (const std::runtime_error&) {
        pair.apart = false;  // undecided: the two hover at the standoff, rows take care of them
        return length;
      }
    }
    const double speed = pair.closing_speed(now.normal, length) + pair.release_speed;
    if (!pair.is_fast(speed, now.normal, length, step_of(pair))) return length;
    const double calm = std::min(kFastMotion * pair.half_width / speed,
                                 kTurn / pair.turn_rate(speed, now.normal, length));
    return std::min(length, std::max(calm, shortest_contact));
  }

  const mjModel_* model_;
  const mjData_* data_;
  const double whole_, remaining_;
  const std::vector<Motion> velocity_, acceleration_;
  std::vector<Bound> bound_;  // by geom
  std::vector<Loaded> loaded_;
  std::vector<std::array<int, 2>> pressed_;
  std::vector<FastPair> pairs_;
  std::vector<int> pair_of_contact_;
};

}  // namespace

Part part_before_impact(const mjModel_* model, const mjData_* data, const Memory& memory,
                        const std::vector<double>& acceleration,
                        const std::vector<ConstraintInput>& constraints,
                        const std::vector<ContactInput>& contacts, double whole, double remaining,
                        int cuts_left, ProvenApart& proven) {
  Part part;
  part.length = remaining;
  if (contacts.empty()) return part;
  ImpactSearch search(model, data, memory, acceleration, whole, remaining);
  search.find_fast(contacts);
  if (!search.any()) return part;
  search.recall(proven);
  const double length = search.find_part(cuts_left);
  search.remember(proven);
  part.impact = search.pairs_in_touch();
  if (cuts_left == 0) return part;
  part.length = length;
  part.apart = search.pairs_apart(constraints, contacts);
  return part;
}

void drop_pairs(const std::vector<GeomPair>& pairs, std::vector<ContactInput>& contacts) {
  if (pairs.empty()) return;
  const auto is_dropped = [&](const ContactInput& contact) {
    return std::binary_search(pairs.begin(), pairs.end(), contact.geom);
  };
  contacts.erase(std::remove_if(contacts.begin(), contacts.end(), is_dropped), contacts.end());
}

}  // namespace dashpot
