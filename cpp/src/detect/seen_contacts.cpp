#include "seen_contacts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/detect/collisions.hpp"
#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/geometry/squared_distance.hpp"
#include "dashpot/geometry/terrain_contacts.hpp"
#include "moved_geom.hpp"
#include "side_by_side.hpp"

namespace dashpot::host {

namespace {

// A place in the frame of a geom, turned on by what the geom has spun about its own axis.
std::array<double, 3> before_spin(const ContactMotion& motion, int side, const mjtNum* rotation,
                                  double time, const std::array<double, 3>& local) {
  if (!has_round_side(motion.geom_type(side))) return local;
  const mjtNum axis[3] = {rotation[2], rotation[5], rotation[8]};
  const double angle = time * mju_dot3(motion.angular(side), axis);
  const double cosine = std::cos(angle), sine = std::sin(angle);
  return {cosine * local[0] - sine * local[1], sine * local[0] + cosine * local[1], local[2]};
}

}  // namespace

double squared_distance_on_geoms(const ContactInput& start, const SeenContact& seen) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 2; ++i)
    least = std::min({least, squared_distance(start.local_position[i].data(), seen.local[i].data()),
                      squared_distance(start.local_position[i].data(), seen.on_shape[i].data())});
  return least;
}

void SeenContacts::find(mjModel* m, mjData* d, double time, double reach, FaceBuffers& faces) {
  const int geom1 = motion_.geom(0), geom2 = motion_.geom(1);
  const MovedGeom moved1(m, d, geom1, time), moved2(m, d, geom2, time);
  const ReplacedCollisions replaced(m, &faces, nullptr);
  mjPreContact found[mjMAXCONPAIR];
  count_ = collide_all(m, d, geom1, geom2, reach, found);
  for (int i = 0; i < count_; ++i) {
    SeenContact& seen = contact_[i];
    seen.distance = found[i].dist;
    mju_copy3(seen.position, found[i].pos);
    mju_copy3(seen.normal, found[i].normal);
    for (int side = 0; side < 2; ++side) {
      const mjtNum* rotation = d->geom_xmat + 9 * motion_.geom(side);
      mjtNum arm[3];
      mju_sub3(arm, found[i].pos, d->geom_xpos + 3 * motion_.geom(side));
      mju_mulMatTVec3(seen.local[side].data(), rotation, arm);
      mju_mulMatTVec3(seen.local_normal[side], rotation, found[i].normal);
      seen.on_shape[side] = before_spin(motion_, side, rotation, time, seen.local[side]);
    }
  }
  mju_copy(rotation_, d->geom_xmat + 9 * geom1, 9);
}

const SeenContact* SeenContacts::continuation(const ContactInput& contact) const {
  const SeenContact* const end = contact_.data() + count_;
  const SeenContact* const nearest =
      std::min_element(contact_.data(), end, [&](const SeenContact& a, const SeenContact& b) {
        return distance_of(contact, a) < distance_of(contact, b);
      });
  return nearest == end || std::isinf(distance_of(contact, *nearest)) ? nullptr : nearest;
}

ContactInput* SeenContacts::start_of(const SeenContact& seen, ContactInput* first,
                                     ContactInput* last) const {
  return std::min_element(first, last, [&](const ContactInput& a, const ContactInput& b) {
    return distance_of(a, seen) < distance_of(b, seen);
  });
}

// Squared, infinite where the one is no continuation of the other.
double SeenContacts::distance_of(const ContactInput& contact, const SeenContact& seen) const {
  return is_across_groove(contact, seen) ? std::numeric_limits<double>::infinity()
                                         : squared_distance_on_geoms(contact, seen);
}

// Whether the two are on sides of a height field that rise from each other. What rolls from the
// one to the other hits that, but for what is soft enough to touch both in one place; where the
// surface stands out the normal turns on. A contact apart is with the plane of its side, wherever
// that side begins.
bool SeenContacts::is_across_groove(const ContactInput& contact, const SeenContact& seen) const {
  if (motion_.geom_type(0) != mjGEOM_HFIELD) return false;
  mjtNum start[3], turn[3], way[3], relative[3];
  mju_mulMatTVec3(start, contact.rotation.data(), contact.frame.data());
  mju_mulMatTVec3(turn, rotation_, seen.normal);
  mju_subFrom3(turn, start);
  const double angle = mju_norm3(turn), size = motion_.size(), small = kStillWay * size;
  if (angle <= kFlatBend) return false;
  mju_mulMatTVec3(relative, contact.rotation.data(), motion_.relative());
  const double approach = length_ * mju_dot3(turn, relative);
  if (are_in_one_place(contact.gap, angle * size, angle, approach)) return false;
  mju_sub3(way, seen.local[0].data(), contact.local_position[0].data());
  return contact.gap > small || mju_dot3(turn, way) < -small * angle;
}

}  // namespace dashpot::host
