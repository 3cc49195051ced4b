// A pair of geoms at a time within a step, and what contacts of its start are then.
//
// Collision of the pair alone is asked again with the geoms where the velocities of the start bring
// them in the time t. A contact that is found then has the acceleration of its gap and of sliding
//
//     dJ/dt xi = (u(t) - u(0)) / t ,
//
// u: rate of the two points that touch, by the velocities of the start. Each free body sees the
// point from where its centre of mass is at the start; axes of joints and twists go to that time.
//
// What goes on far in a step may be past an edge by then: a ball that slides off a tile meets its
// edge in the middle, though it is on the next tile. A contact between round surfaces goes on,
// since these have no edges. So does one where nothing else touches the two: past an edge they
// fall. All others keep the geometry of the start. So do blows, which are over or to come by then.

#pragma once

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "contact_motion.hpp"
#include "dashpot/detect/collisions.hpp"
#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/geometry/slots_by_pair.hpp"
#include "dashpot/geometry/terrain.hpp"
#include "dashpot/rows/rows.hpp"
#include "face_contacts.hpp"
#include "pair_hits.hpp"

namespace dashpot::host {

// A contact that the collision of a pair finds then, and its place on the two geoms.
struct SeenContact {
  mjtNum distance, position[3], normal[3];
  mjtNum local_normal[2][3];  // in the frames of the geoms
  std::array<double, 3> local[2];
  std::array<double, 3> on_shape[2];  // the same on what does not turn about its own axis
};

// How far, relative to the size of the smaller geom, a contact point moves on along a rim or a
// surface up to the middle: that of a disc almost at rest runs faster than steps can follow.
constexpr double kFarPoint = 0.5;
// 1 - cos of the angle between the normals of one contact at the start and in the middle, at most;
// at other times it goes with the square of the time.
constexpr double kMostTurnOfNormal = 0.15;
// Way in a step, relative to the size of the smaller geom, up to which a pair meets where it did.
constexpr double kFarWay = 0.1;
// How far off, relative to the same, what rolls or slides along still is.
constexpr double kNear = 0.5 * kFarWay;
// Change of the cosine of a normal to the axis of a round side up to which it is along one line.
constexpr double kSameLine = 1e-3;
// Gap rate up to which a pair runs along, of sqrt(g r): until then what rests falls by r / 200.
constexpr double kAlong = 0.095;

inline void to_local(const mjData* d, int geom, const mjtNum* direction, mjtNum* local) {
  mju_mulMatTVec3(local, d->geom_xmat + 9 * geom, direction);
}

// A place in the frame of a geom, turned on by what the geom has spun about its own axis.
inline std::array<double, 3> before_spin(const ContactMotion& motion, int side,
                                         const mjtNum* rotation, double time,
                                         const std::array<double, 3>& local) {
  if (!has_round_side(motion.geom_type(side))) return local;
  const mjtNum axis[3] = {rotation[2], rotation[5], rotation[8]};
  const double angle = time * mju_dot3(motion.angular(side), axis);
  const double cosine = std::cos(angle), sine = std::sin(angle);
  return {cosine * local[0] - sine * local[1], sine * local[0] + cosine * local[1], local[2]};
}

// Squared distance (m^2) of the places of two contacts on the geom on which they are nearer: on a
// wheel, the place as it turns with it, or stays.
inline double squared_distance_on_geoms(const ContactInput& start, const SeenContact& seen) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 2; ++i)
    least = std::min({least, squared_distance(start.local_position[i].data(), seen.local[i].data()),
                      squared_distance(start.local_position[i].data(), seen.on_shape[i].data())});
  return least;
}

class PairAhead {
 public:
  // Of the contacts from `first` to `last`, of geoms that move as `motion` says, over `length` (s).
  PairAhead(mjModel* m, mjData* d, ContactMotion& motion, const IsolatedPairs& pairs, double length,
            ContactInput* first, ContactInput* last)
      : model_(m),
        data_(d),
        motion_(motion),
        pairs_(pairs),
        length_(length),
        first_(first),
        last_(last) {}

  // Finds how far the pair goes. False: so far that its contacts keep the geometry of the start.
  bool may_be_followed() {
    is_far_ = motion_.geom_type(0) != mjGEOM_PLANE && motion_.way() > kFarWay * motion_.size();
    if (!is_far_) return true;
    if (!runs_along(*first_)) return false;
    mjtNum normal[2][3];
    for (int side = 0; side < 2; ++side)
      to_local(data_, motion_.geom(side), first_->frame.data(), normal[side]);
    on_round_ = touches_round(normal[0], normal[1]);
    return true;
  }

  // Collides the geoms where they are after a time (s), out to `apart` (m) beyond how far they move
  // up to then. Their poses are those of the start again afterwards.
  void look(double time, FaceBuffers& faces, double apart = 0.0) {
    time_ = time;
    way_ = motion_.way_in(std::abs(time));
    const double reach = first_->margin + way_ + apart;
    collide(reach, faces);
    motion_.find_twists(time);
  }

  // That time, 0 before.
  double time() const { return time_; }

  // What a contact is then, null if it is not there. `is_round_hit`: of two round bodies that hit
  // each other alone, which may go far, but turn evenly.
  ContactInput* find(const ContactInput& contact, bool is_round_hit) {
    const SeenContact* const same = continuation(contact);
    if (!same) return nullptr;
    const double part = is_round_hit ? 1.0 : std::min(1.0, std::abs(time_) / (0.5 * length_));
    const double far = motion_.have_corners() ? 2.0 * way_ : part * kFarPoint * motion_.size();
    if (squared_distance_on_geoms(contact, *same) > far * far) return nullptr;
    if (1.0 - mju_dot3(same->normal, contact.frame.data()) > part * part * kMostTurnOfNormal)
      return nullptr;
    if (!is_round_hit && !follows(contact, *same)) return nullptr;
    then_ = seen_in(*same, contact);
    const std::array<double, 3> before = motion_.point_rate(contact, ContactMotion::When::kStart),
                                then = motion_.point_rate(then_, ContactMotion::When::kThen);
    for (int i = 0; i < 3; ++i) then_.turning[i] = (then[i] - before[i]) / time_;
    return &then_;
  }

  // The same of one that comes on, wherever it goes, with its gap (m) then.
  ContactInput* find_coming(const ContactInput& contact) {
    const SeenContact* const same = continuation(contact);
    if (!same) return nullptr;
    then_ = seen_in(*same, contact);
    then_.gap = same->distance - contact.margin;
    return &then_;
  }

 private:
  void collide(double reach, FaceBuffers& faces) {
    const int geom1 = motion_.geom(0), geom2 = motion_.geom(1);
    const MovedGeom moved1(model_, data_, geom1, time_), moved2(model_, data_, geom2, time_);
    const ReplacedCollisions replaced(model_, &faces, nullptr);
    mjPreContact found[mjMAXCONPAIR];
    count_ = collide_all(model_, data_, geom1, geom2, reach, found);
    for (int i = 0; i < count_; ++i) {
      SeenContact& seen = seen_[i];
      seen.distance = found[i].dist;
      mju_copy3(seen.position, found[i].pos);
      mju_copy3(seen.normal, found[i].normal);
      for (int side = 0; side < 2; ++side) {
        const mjtNum* rotation = data_->geom_xmat + 9 * motion_.geom(side);
        mjtNum arm[3];
        mju_sub3(arm, found[i].pos, data_->geom_xpos + 3 * motion_.geom(side));
        mju_mulMatTVec3(seen.local[side].data(), rotation, arm);
        mju_mulMatTVec3(seen.local_normal[side], rotation, found[i].normal);
        seen.on_shape[side] = before_spin(motion_, side, rotation, time_, seen.local[side]);
      }
    }
    mju_copy(rotation_, data_->geom_xmat + 9 * geom1, 9);
  }

  // The nearest contact then that continues one of the start, null if none does.
  const SeenContact* continuation(const ContactInput& contact) const {
    const SeenContact* const end = seen_.data() + count_;
    const SeenContact* const nearest =
        std::min_element(seen_.data(), end, [&](const SeenContact& a, const SeenContact& b) {
          return distance_of(contact, a) < distance_of(contact, b);
        });
    if (nearest == end || std::isinf(distance_of(contact, *nearest))) return nullptr;
    const ContactInput* const start =
        std::min_element(first_, last_, [&](const ContactInput& a, const ContactInput& b) {
          return distance_of(a, *nearest) < distance_of(b, *nearest);
        });
    return start == &contact ? nearest : nullptr;
  }

  // Squared, infinite where the one is no continuation of the other.
  double distance_of(const ContactInput& contact, const SeenContact& seen) const {
    return is_across_groove(contact, seen) ? std::numeric_limits<double>::infinity()
                                           : squared_distance_on_geoms(contact, seen);
  }

  // Whether the two are on sides of a height field that rise from each other. What rolls from the
  // one to the other hits that, but for what is soft enough to touch both in one place; where the
  // surface stands out the normal turns on. A contact apart is with the plane of its whole side.
  bool is_across_groove(const ContactInput& contact, const SeenContact& seen) const {
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

  // Whether a contact that is seen then may be one of the start.
  bool follows(const ContactInput& start, const SeenContact& seen) const {
    if (start.continued >= 0 && is_past_end(start, seen)) return false;
    if (!is_far_) return true;
    if (on_round_ && touches_round(seen.local_normal[0], seen.local_normal[1])) return true;
    return start.gap <= kNear * motion_.size() && runs_along(start) &&
           pairs_.is_alone(start, length_);
  }

  // Not into or out of each other.
  bool runs_along(const ContactInput& contact) const {
    return std::abs(motion_.gap_rate(contact)) <
           kAlong * std::sqrt(motion_.gravity() * motion_.size());
  }

  bool touches_round(const mjtNum* local_normal1, const mjtNum* local_normal2) const {
    return motion_.is_round_along(0, local_normal1) && motion_.is_round_along(1, local_normal2);
  }

  // Past the end of a surface that another geom continues.
  bool is_past_end(const ContactInput& start, const SeenContact& seen) const {
    const int side = start.continued, type = motion_.geom_type(side);
    mjtNum normal[3];
    to_local(data_, motion_.geom(side), start.frame.data(), normal);
    if (has_round_side(type) && std::abs(normal[2]) < kSameLine)
      return std::abs(seen.local_normal[side][2] - normal[2]) > kSameLine;
    return has_faces(type) && mju_dot3(normal, seen.local_normal[side]) < kOfFace;
  }

  // The geometry that a contact has as it is seen then.
  ContactInput seen_in(const SeenContact& seen, ContactInput contact) const {
    const double apart = std::max(0.0, seen.distance - contact.margin);
    mjtNum point[2][3];
    for (int i = 0; i < 2; ++i) {
      mju_addScl3(point[i], seen.position, seen.normal, (i == 0 ? -0.5 : 0.5) * apart);
      if (motion_.is_free(i)) mju_addToScl3(point[i], motion_.linear(i), -time_);
    }
    for (int i = 0; i < 3; ++i) {
      contact.position[i] = 0.5 * (point[0][i] + point[1][i]);
      contact.apart[i] = point[1][i] - point[0][i];
    }
    mjtNum* const frame = contact.frame.data();
    mju_copy3(frame, seen.normal);
    mju_addToScl3(frame + 3, frame, -mju_dot3(frame, frame + 3));
    mju_normalize3(frame + 3);
    mju_cross(frame + 6, frame, frame + 3);
    contact.ahead = time_;
    std::copy_n(rotation_, 9, contact.rotation.begin());
    return contact;
  }

  mjModel* model_;
  mjData* data_;
  ContactMotion& motion_;
  const IsolatedPairs& pairs_;
  double length_;
  ContactInput *first_, *last_;
  bool is_far_ = false, on_round_ = false;
  double time_ = 0.0, way_ = 0.0;  // s, and how far (m) the pair moves up to then
  std::array<SeenContact, mjMAXCONPAIR> seen_;
  int count_ = 0;
  mjtNum rotation_[9]{};  // of the first geom then, row-major, local to world
  ContactInput then_;
};

}  // namespace dashpot::host
