// Pairs of geoms whose relative motion in a step is not small against the thinner of the two. Let
//
//     s = a bound on the speed at which any two points of the pair approach, with that which its
//         compressed contacts can still give it in a step, x sqrt(k w) min(1, sqrt(k w) H),
//     e = half the least width of its thinner geom.
//
// A pair is fast where s H > e / 4, or where such motion turns one of the two, or the normal of two
// round ones, by more than 0.05 rad in the step.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/pair_motion.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

struct FastPair : PairMotion {
  double margin = 0.0;   // m, distance at which contact starts
  bool apart = false;    // from each other, proven for this substep
  double clear = 0.0;    // s, how long it is proven
  bool pressed = false;  // round, with compression remembered
};

// A blow between round bodies that has begun fast goes on so: substeps of another length end it as
// another blow. Factor on the step, by which its pair counts as fast.
constexpr double kGoesOn = 2.0;

// Finds fast pairs, by the motion that a model has now, over what remains of a step.
class FastPairs {
 public:
  // `acceleration` (nv): the mean smooth one over `remaining` (s) of a step of `whole` (s).
  FastPairs(const mjModel_* model, const mjData_* data, const Memory& memory,
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

  // Finds the fast pairs among those that collision reports: `pairs`, and by contact the index of
  // its pair, -1 where that is not fast.
  void find(const std::vector<ContactInput>& contacts) {
    pair_of_contact.assign(contacts.size(), -1);
    for (size_t i = 0; i < contacts.size(); ++i) {
      const ContactInput& contact = contacts[i];
      const bool known =
          i > 0 && contacts[i - 1].geom == contact.geom && pair_of_contact[i - 1] >= 0;
      if (!known) {
        if (is_slow(contact.geom)) continue;
        if (!has_shape(model_, contact.geom[0]) || !has_shape(model_, contact.geom[1])) continue;
        const FastPair pair = make_pair(contact);
        if (!is_fast(pair, contact)) continue;
        pairs.push_back(pair);
      }
      const int index = static_cast<int>(pairs.size()) - 1;
      for (size_t j = i + 1; j-- > 0 && contacts[j].geom == contact.geom;)
        pair_of_contact[j] = index;
    }
  }

  std::vector<FastPair> pairs;
  std::vector<int> pair_of_contact;

  // Whether a pair is fast that approaches at `speed` (m/s) over `length` (s).
  bool is_fast(const FastPair& pair, double speed, const Eigen::Vector3d& normal,
               double length) const {
    return pair.is_fast(speed, normal, length, pair.pressed ? kGoesOn * whole_ : whole_);
  }

 private:
  // What bounds a geom's part in any pair.
  struct Bound {
    double half_width = 0.0;  // m
    double radius = 0.0;      // m, reach of the core about the body's centre of mass
    double speed = 0.0;       // m/s, of its points
    double calm_way = 0.0;    // m, relative motion in a step that asks for nothing
  };
  // A pair whose compressed contacts hold enough to make it fast.
  struct Loaded {
    std::array<int, 2> geom;
    double speed_squared;
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
    const auto mean = [&](const Eigen::Vector3d& velocity, const Eigen::Vector3d& acceleration) {
      return (velocity + 0.5 * remaining_ * acceleration).norm();
    };
    bound.speed = mean(velocity_[body].linear, acceleration_[body].linear) +
                  mean(velocity_[body].angular, acceleration_[body].angular) * bound.radius;
    return bound;
  }

  double half_width(const GeomPair& geom) const {
    return std::min(bound_[geom[0]].half_width, bound_[geom[1]].half_width);
  }

  // In any direction.
  bool is_slow(const GeomPair& geom) const {
    const double speed = bound_[geom[0]].speed + bound_[geom[1]].speed + release_speed(geom);
    return speed * kGoesOn * whole_ <= std::min(bound_[geom[0]].calm_way, bound_[geom[1]].calm_way);
  }

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

  FastPair make_pair(const ContactInput& contact) const {
    FastPair pair;
    pair.margin = std::max(0.0, contact.margin);
    for (int i = 0; i < 2; ++i) {
      SideMotion& side = pair.side[i];
      side.geom = contact.geom[i];
      side.tree = contact.tree[i];
      side.is_free = side.tree < 0 || host::is_free_body(model_, side.tree);
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
    pair.flies = pair.side[0].is_free && pair.side[1].is_free;
    return pair;
  }

  bool is_fast(const FastPair& pair, const ContactInput& contact) const {
    const Eigen::Vector3d normal(contact.frame[0], contact.frame[1], contact.frame[2]);
    const bool touches = contact.gap <= 2.0 * pair.standoff(remaining_);
    const double speed = pair.has_plane || touches ? pair.closing_speed(normal, remaining_)
                                                   : pair.closing_speed(remaining_);
    return is_fast(pair, speed + pair.release_speed, normal, remaining_);
  }

  const mjModel_* model_;
  const mjData_* data_;
  const double whole_, remaining_;
  const std::vector<Motion> velocity_, acceleration_;
  std::vector<Bound> bound_;  // by geom
  std::vector<Loaded> loaded_;
  std::vector<std::array<int, 2>> pressed_;
};

}  // namespace dashpot
