#include "dashpot/impacts/flight_contacts.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "dashpot/geometry/pair_motion.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/impacts/impact.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Ways of the two geoms in the step, relative to the half-width of the thinner one, up to which
// normals of faces at the start are good: past a ball of radius r, a way x leads below its tangent
// plane by x^2 / (4 r) at most.
constexpr double kFarWay = 0.1;
// The same of two round shapes, whose normal turns all the way: by half of this (rad), while what
// lies below the tangent plane is a few hundredths of what they compress in a blow along the way.
constexpr double kFarWayOfRound = 0.01;
// Cosine between the normals of a contact at the start and at the impact above which the first is
// good: a face that lands flat keeps all of its points. Round shapes meet along their own.
constexpr double kNormalHolds = 0.999;
// Clearance, relative to the half-width of the thinner geom, that counts as touch of round ones: a
// miss by so little may as well touch.
constexpr double kClearance = 1e-3;
// The same of all others, which have edges: from as far as a clearance c the normal of what is
// round is off by sqrt(2 c / r) there, and that of an edge which passes by c is across its way.
// What is round and comes nearer than the clearance, but not as near, is left to where contacts
// that come on are frozen (detect/turning.hpp).
constexpr double kTouch = 1e-6;

class FlightSearch {
 public:
  FlightSearch(const mjModel_* model, const mjData_* data, const host::ReachBuffers& reach,
               const std::vector<ContactInput>& contacts, double length, GeomShapes& shapes,
               std::vector<Flight>& flights, std::vector<char>& disturbed)
      : model_(model),
        data_(data),
        reach_(reach),
        contacts_(contacts),
        length_(length),
        shapes_(shapes),
        flights_(flights),
        disturbed_(disturbed) {}

  bool find_flights() {
    flights_.clear();
    for (size_t first = 0, last; first < contacts_.size(); first = last) {
      last = first + 1;
      while (last < contacts_.size() && contacts_[last].is_of_pair(contacts_[first].geom)) ++last;
      if (!is_flight(first, last)) continue;
      flights_.emplace_back();
      flights_.back().first = first;
      flights_.back().last = last;
    }
    return !flights_.empty();
  }

  void follow(const std::vector<ConstraintInput>& constraints) {
    disturbed_.assign(host::tree_count(model_), 0);
    for (const ConstraintInput& constraint : constraints) disturb(constraint.tree);
    size_t next = 0;
    for (size_t i = 0; i < contacts_.size(); ++i) {
      while (next < flights_.size() && flights_[next].last <= i) ++next;
      const bool flies = next < flights_.size() && flights_[next].first <= i;
      if (!flies && acts(contacts_[i])) disturb(contacts_[i].tree);
    }
    for (Flight& flight : flights_)
      if (!is_disturbed(flight)) follow(contacts_[flight.first], flight);
    for (const Flight& flight : flights_)
      if (!flight.misses) disturb(contacts_[flight.first].tree);
    // What is disturbed may come to anything that a contact joins to it.
    for (bool changed = true; changed;) {
      changed = false;
      for (const ContactInput& contact : contacts_)
        if (is_disturbed(contact.tree)) changed = disturb(contact.tree) || changed;
    }
    for (Flight& flight : flights_) flight.misses = flight.misses && !is_disturbed(flight);
  }

  void near_misses(std::vector<GeomPair>& misses) const {
    for (const Flight& flight : flights_)
      if (flight.misses) misses.push_back(contacts_[flight.first].geom);
    std::sort(misses.begin(), misses.end());
  }

  // Flights that end along another normal than the contacts found have, or where none closes.
  void redirected(std::vector<Flight>& redirected) const {
    for (const Flight& flight : flights_) {
      const auto begin = contacts_.begin() + flight.first, end = contacts_.begin() + flight.last;
      const bool alone = flight.last - flight.first == 1 && are_round(*begin);
      const auto stands_for_it = [&](const ContactInput& contact) {
        const Vector3d normal(contact.frame[0], contact.frame[1], contact.frame[2]);
        return !alone && normal.dot(flight.normal) > kNormalHolds && acts(contact);
      };
      if (flight.meets && std::none_of(begin, end, stands_for_it)) redirected.push_back(flight);
    }
  }

 private:
  bool is_flight(size_t first, size_t last) const {
    if (contacts_[first].is_of_flex()) return false;
    const auto flies = [&](int tree) { return tree < 0 || host::is_free_body(model_, tree); };
    if (!flies(contacts_[first].tree[0]) || !flies(contacts_[first].tree[1])) return false;
    size_t nearest = first;
    for (size_t i = first; i < last; ++i) {
      if (contacts_[i].gap <= 0.0 || contacts_[i].continued >= 0) return false;
      if (contacts_[i].gap < contacts_[nearest].gap) nearest = i;
    }
    const ContactInput& contact = contacts_[nearest];
    return can_be_followed(contact.geom[0]) && can_be_followed(contact.geom[1]) &&
           (goes_far(contact) || may_pass_an_edge(first, last));
  }

  bool goes_far(const ContactInput& contact) const {
    const bool round = are_round(contact);
    const double far = (round ? kFarWayOfRound : kFarWay) * half_width(contact);
    return reach_.reach[contact.geom[0]] + reach_.reach[contact.geom[1]] > far &&
           moves_along(contact, far);
  }

  // Whether the plane of a contact is crossed in the step. An edge that is nearer than the way
  // turns it on a way of any length: what is released 0.5 to 5 mm above a rim that it clears by up
  // to a millimetre crossed that of the start in one of eight falls at 5 ms.
  bool may_pass_an_edge(size_t first, size_t last) const {
    if (are_round(contacts_[first])) return false;
    return std::any_of(contacts_.begin() + first, contacts_.begin() + last,
                       [&](const ContactInput& contact) { return acts(contact); });
  }

  // Whether a pair may meet in the step after it has moved along the contact's plane by more than
  // `far` (m), or turned.
  bool moves_along(const ContactInput& contact, double far) const {
    const Vector3d normal(contact.frame[0], contact.frame[1], contact.frame[2]);
    Vector3d relative = Vector3d::Zero();
    double turning = 0.0, closing = 0.0, turn = 0.0;
    for (int side = 0; side < 2; ++side) {
      const int geom = contact.geom[side], body = geom_body(model_, geom);
      const Motion motion = mean(body);
      const double reach =
          geom_bounds(model_, geom).core_radius + geom_offset(data_, geom, motion.centre);
      relative += (side ? 1.0 : -1.0) * motion.linear;
      closing += normal.cross(motion.angular).norm() * reach;
      turning += motion.angular.norm() * reach;
      turn = std::max(turn, motion.angular.norm());
    }
    closing -= normal.dot(relative);
    const bool nearest = is_nearest(contact.geom[0]) && is_nearest(contact.geom[1]);
    const double slack = kClearance * half_width(contact);
    if (contact.gap > length_ * (nearest ? closing : relative.norm() + turning) + slack)
      return false;
    const double along = (relative - normal.dot(relative) * normal).norm() + turning;
    return length_ * along > far || length_ * turn > kFastTurn;
  }

  // Whether collision finds the nearest points. MuJoCo's routine for general convex geoms may
  // report others: of a capsule 0.03 mm from a cylinder a point 2 mm away.
  bool is_nearest(int geom) const {
    const ShapeType type = shapes_.of(model_, geom).type;
    return type == ShapeType::kSphere || type == ShapeType::kCapsule || type == ShapeType::kBox;
  }

  bool can_be_followed(int geom) const {
    return has_shape(model_, geom) && has_core(shapes_.of(model_, geom));
  }

  // Touches, or closes within the step.
  bool acts(const ContactInput& contact) const {
    return contact.gap <= 0.0 || contact.gap + length_ * mean_rate(contact) <= 0.0;
  }

  // Rate of a contact's gap over the step.
  double mean_rate(const ContactInput& contact) const {
    if (contact.is_of_flex()) return host::contact_velocity(model_, data_, contact)[0];
    const Vector3d normal(contact.frame[0], contact.frame[1], contact.frame[2]);
    const Eigen::Map<const Vector3d> point(contact.position.data());
    double rate = 0.0;
    for (int side = 0; side < 2; ++side) {
      const Motion motion = mean(geom_body(model_, contact.geom[side]));
      rate += (side ? 1.0 : -1.0) *
              normal.dot(motion.linear + motion.angular.cross(point - motion.centre));
    }
    return rate;
  }

  // Whether any of the trees was not disturbed before.
  bool disturb(const std::array<int, 2>& trees) {
    bool changed = false;
    for (int tree : trees) {
      changed = changed || (tree >= 0 && !disturbed_[tree]);
      if (tree >= 0) disturbed_[tree] = 1;
    }
    return changed;
  }
  bool is_disturbed(const std::array<int, 2>& trees) const {
    return std::any_of(trees.begin(), trees.end(),
                       [&](int tree) { return tree >= 0 && disturbed_[tree]; });
  }
  bool is_disturbed(const Flight& flight) const {
    return is_disturbed(contacts_[flight.first].tree);
  }

  Motion at_start(int body) const {
    return body_motion(model_, data_, body, reach_.now.data() + 6 * body);
  }

  Motion at_end(int body) const {
    return body_motion(model_, data_, body, reach_.later.data() + 6 * body);
  }

  Motion mean(int body) const {
    double mean[6];
    for (int i = 0; i < 6; ++i)
      mean[i] = 0.5 * (reach_.now[6 * body + i] + reach_.later[6 * body + i]);
    return body_motion(model_, data_, body, mean);
  }

  // m, of the thinner geom of a contact.
  double half_width(const ContactInput& contact) const {
    return std::min(geom_bounds(model_, contact.geom[0]).half_width,
                    geom_bounds(model_, contact.geom[1]).half_width);
  }

  bool one_is_round(const ContactInput& contact) const {
    return geom_bounds(model_, contact.geom[0]).is_round !=
           geom_bounds(model_, contact.geom[1]).is_round;
  }

  bool are_round(const ContactInput& contact) const {
    return geom_bounds(model_, contact.geom[0]).is_round &&
           geom_bounds(model_, contact.geom[1]).is_round;
  }

  // Follows the geoms of a contact to where they meet or pass by.
  void follow(const ContactInput& contact, Flight& flight) const {
    Shape shape[2];
    Pose pose[2];
    Motion motion[2];
    double departure = 0.0;  // m/s^2, of points from turning at the mean rate
    for (int side = 0; side < 2; ++side) {
      const int geom = contact.geom[side], body = geom_body(model_, geom);
      shape[side] = shapes_.of(model_, geom);
      pose[side] = geom_pose(model_, data_, geom);
      const Motion start = at_start(body), end = at_end(body);
      motion[side] = mean(body);
      motion[side].linear = start.linear;
      motion[side].acceleration = (end.linear - start.linear) / length_;
      const double arm =
          geom_bounds(model_, geom).core_radius + geom_offset(data_, geom, start.centre);
      departure += (end.angular - start.angular).norm() / length_ * arm;
    }
    const double touch = (are_round(contact) ? kClearance : kTouch) * half_width(contact);
    const double clearance = touch + departure * length_ * length_ / 8.0;
    const auto impact_within = [&](double distance) {
      return time_of_impact(shape[0], pose[0], motion[0], shape[1], pose[1], motion[1], length_,
                            std::max(0.0, contact.margin) + distance);
    };
    TimeOfImpact impact;
    try {
      impact = impact_within(clearance);
      if (impact.hit && one_is_round(contact) && clearance > touch) {
        impact = impact_within(touch);
        if (!impact.hit) return;
      }
    } catch (const UndecidedImpact&) {
      return;  // undecided: contacts stay as they were found
    }
    flight.misses = !impact.hit;
    flight.normal = impact.at.normal;
    Vector3d way = Vector3d::Zero();
    for (int side = 0; side < 2; ++side) {
      const Pose then = advance(pose[side], motion[side], impact.time);
      const Vector3d& point = side ? impact.at.point2 : impact.at.point1;
      const Vector3d moved = motion[side].way(impact.time);
      const Vector3d arm = point - motion[side].centre - moved;
      way += (side ? 1.0 : -1.0) * (moved + impact.time * motion[side].angular.cross(arm));
      flight.point[side] = motion[side].centre + arm;
      flight.local[side] = then.rotation.transpose() * (point - then.position);
    }
    flight.gap = impact.at.distance - contact.margin - flight.normal.dot(way);
    // What is about to touch at the start has the right normals already.
    flight.meets = impact.hit && impact.time > 0.0 && flight.gap > 0.0;
  }

  const mjModel_* model_;
  const mjData_* data_;
  const host::ReachBuffers& reach_;
  const std::vector<ContactInput>& contacts_;
  const double length_;
  GeomShapes& shapes_;
  std::vector<Flight>& flights_;  // in the order of their contacts
  std::vector<char>& disturbed_;  // by tree: something else may act on it
};

}  // namespace

void FlightContacts::follow(const mjModel_* model, mjData_* data, const host::ReachBuffers& reach,
                            const std::vector<ConstraintInput>& constraints, double length,
                            std::vector<ContactInput>& contacts) {
  misses_.clear();
  redirected_.clear();
  FlightSearch search(model, data, reach, contacts, length, shapes_, flights_, disturbed_);
  if (!search.find_flights()) return;
  search.follow(constraints);
  search.near_misses(misses_);
  search.redirected(redirected_);
  // From the last on: places of the others stay.
  for (auto flight = redirected_.rbegin(); flight != redirected_.rend(); ++flight) {
    const auto first = contacts.begin() + flight->first, last = contacts.begin() + flight->last;
    const auto nearest = std::min_element(
        first, last, [](const ContactInput& a, const ContactInput& b) { return a.gap < b.gap; });
    std::iter_swap(first, nearest);
    const Vector3d apart = flight->point[1] - flight->point[0];
    const Vector3d middle = flight->point[0] + 0.5 * apart;
    host::redirect_contact(data, middle.data(), flight->normal.data(), flight->gap, *first);
    std::copy_n(apart.data(), 3, first->apart.begin());
    for (int side = 0; side < 2; ++side)
      std::copy_n(flight->local[side].data(), 3, first->local_position[side].begin());
    first->frozen = Frozen::kAtImpact;
    contacts.erase(first + 1, last);
  }
  drop_pairs(misses_, contacts);
}

}  // namespace dashpot
