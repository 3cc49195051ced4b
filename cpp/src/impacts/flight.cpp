#include "dashpot/impacts/flight.hpp"

#include <Eigen/Geometry>
#include <algorithm>

#include "dashpot/detect/reach.hpp"
#include "dashpot/geometry/pair_motion.hpp"
#include "dashpot/geometry/query.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

// The same of all others, which have edges: from as far as a clearance c the normal of what is
// round is off by sqrt(2 c / r) there, and that of an edge which passes by c is across its way.
// What is round and comes nearer than the clearance, but not as near, is left to where contacts
// that come on are frozen (detect/turning.hpp).
constexpr double kTouch = 1e-6;

}  // namespace

Motion FlightPaths::at_start(int body) const {
  return body_motion(model_, data_, body, reach_.now.data() + 6 * body);
}

Motion FlightPaths::at_end(int body) const {
  return body_motion(model_, data_, body, reach_.later.data() + 6 * body);
}

Motion FlightPaths::mean(int body) const {
  double mean[6];
  for (int i = 0; i < 6; ++i)
    mean[i] = 0.5 * (reach_.now[6 * body + i] + reach_.later[6 * body + i]);
  return body_motion(model_, data_, body, mean);
}

double FlightPaths::half_width(const ContactInput& contact) const {
  return std::min(geom_bounds(model_, contact.geom[0]).half_width,
                  geom_bounds(model_, contact.geom[1]).half_width);
}

bool FlightPaths::one_is_round(const ContactInput& contact) const {
  return geom_bounds(model_, contact.geom[0]).is_round !=
         geom_bounds(model_, contact.geom[1]).is_round;
}

bool FlightPaths::are_round(const ContactInput& contact) const {
  return geom_bounds(model_, contact.geom[0]).is_round &&
         geom_bounds(model_, contact.geom[1]).is_round;
}

void FlightPaths::follow(const ContactInput& contact, Flight& flight) const {
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

}  // namespace dashpot
