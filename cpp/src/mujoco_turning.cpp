#include "dashpot/mujoco_turning.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "dashpot/mujoco_contact_motion.hpp"
#include "dashpot/mujoco_middle_contacts.hpp"
#include "dashpot/mujoco_workplaces.hpp"

namespace dashpot::host {

namespace {

// Turn in a step (rad) up to which a pair is at rest, as kStillWay is for its way.
constexpr double kStillTurn = 1e-5;
// Way in a step, relative to the size of the smaller geom, up to which a pair meets where it did: a
// ball that slides off a tile meets its edge in the middle, though it is on the next tile by then.
// Planes have no edges; beyond, what is round is still on a face whose normal it meets, but for
// blows, which are over or to come by then.
constexpr double kFarWay = 0.1;
// Cosine between the normals, in the frame of a geom, of contacts on one of its faces.
constexpr double kOfFace = 0.999999;
// How far, relative to the same, a contact point moves on along a rim or a surface up to the
// middle: that of a disc that has almost come to rest runs around it faster than steps can follow.
constexpr double kFarPoint = 0.5;
// Part of the step within which a gap or an overlap that closes at its present rate is gone early.
constexpr double kEarly = 0.25;
// Cosine between the normals of one contact at the start and in the middle.
constexpr double kSame = 0.85;
constexpr int kContactsAtOnce = 16;  // by a thread

// The contacts of two geoms over a step.
class TurningPair {
 public:
  // Of the contacts from `first` to `last`; `time` (s) leads to the middle.
  TurningPair(mjModel* m, mjData* d, double time, ContactInput* first, ContactInput* last)
      : model_(m), data_(d), time_(time), first_(first), last_(last), motion_(m, d, time) {}

  // Finds how the pair moves; whether it does, and may touch up to the middle.
  bool moves(const Trees& trees, const double* motion) {
    if (first_->is_at_impact || !motion_.find(*first_, trees, motion)) return false;
    const bool on_plane = motion_.geom_type(0) == mjGEOM_PLANE;
    if (on_plane && motion_.is_free_ball(1)) return false;
    size_ = motion_.size();
    const double way = motion_.way();
    at_rest_ = motion_.turn() <= kStillTurn && way <= kStillWay * size_;
    if (at_rest_) return false;
    is_far_ = way > kFarWay * size_ && !on_plane;
    if (is_far_ && motion_.side_with_faces() < 0) return false;
    if (motion_.are_round() && parts_early()) return false;
    way_ = motion_.way_to_middle();
    return std::any_of(first_, last_, [&](const ContactInput& c) { return c.gap <= way_; });
  }

  // Of a pair whose contacts stay where they are, takes to the middle the axes of the joints that
  // hold it there: those of a leg turn though its foot stands.
  void turn_axes() {
    if (!at_rest_ || !(motion_.joints_move(0, kStillTurn) || motion_.joints_move(1, kStillTurn)))
      return;
    motion_.find_twists();
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      if (contact->gap > 0.0) continue;
      const std::array<double, 3> start = motion_.point_rate(*contact, When::kStart),
                                  middle = motion_.point_rate(*contact, When::kMiddle);
      mjtNum change[3];
      mju_sub3(change, middle.data(), start.data());
      if (2.0 * time_ * mju_norm3(change) <= kStillTurn * kStillWay * size_) continue;
      contact->ahead = time_;
      for (int i = 0; i < 3; ++i) contact->turning[i] = change[i] / time_;
    }
  }

  // Takes the contacts that are found there to the middle.
  void take(FaceBuffers& faces) {
    MiddleContacts found(motion_);
    found.find(model_, data_, time_, first_->margin + way_, faces);
    motion_.find_twists();
    const bool corners =
        has_corners(model_, motion_.geom(0)) && has_corners(model_, motion_.geom(1));
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      // At a seam the middle may be beyond the edge, where the other geom's face goes on.
      if (contact->is_at_seam()) continue;
      const MiddleContact* const same = found.continuation(*contact);
      if (!same || found.start_of(*same, first_, last_) != contact) continue;
      const double far = corners ? 2.0 * way_ : kFarPoint * size_;
      if (squared_distance(*contact, *same) > far * far) continue;
      if (mju_dot3(same->normal, contact->frame.data()) < kSame) continue;
      if (is_far_ && !stays_on_face(*contact, *same)) continue;
      take(*same, found.rotation(), *contact);
    }
  }

 private:
  using When = ContactMotion::When;

  // Whether a blow begins or ends early in the step, by how fast the gap changes: forces that act
  // before the middle alone do work on what the turn of the normal adds to the rate.
  bool parts_early() const {
    return std::abs(first_->gap) < kEarly * 2.0 * time_ * motion_.gap_speed(*first_);
  }

  bool stays_on_face(const ContactInput& contact, const MiddleContact& middle) const {
    if (std::abs(middle.distance - contact.margin - contact.gap) > 0.5 * kFarWay * size_)
      return false;
    const int side = motion_.side_with_faces();
    mjtNum normal[3];
    mju_mulMatTVec3(normal, data_->geom_xmat + 9 * motion_.geom(side), contact.frame.data());
    return mju_dot3(normal, middle.local_normal[side]) > kOfFace;
  }

  // From where its centre of mass is at the start each free body sees the point as in the middle;
  // axes of joints and twists go there themselves. `rotation`: of the first geom, there.
  void take(const MiddleContact& middle, const mjtNum* rotation, ContactInput& contact) const {
    const std::array<double, 3> start_rate = motion_.point_rate(contact, When::kStart);
    const double apart = std::max(0.0, middle.distance - contact.margin);
    mjtNum point[2][3];
    for (int i = 0; i < 2; ++i) {
      mju_addScl3(point[i], middle.position, middle.normal, (i == 0 ? -0.5 : 0.5) * apart);
      if (motion_.is_free(i)) mju_addToScl3(point[i], motion_.linear(i), -time_);
    }
    for (int i = 0; i < 3; ++i) {
      contact.position[i] = 0.5 * (point[0][i] + point[1][i]);
      contact.apart[i] = point[1][i] - point[0][i];
    }
    mjtNum* const frame = contact.frame.data();
    mju_copy3(frame, middle.normal);
    mju_addToScl3(frame + 3, frame, -mju_dot3(frame, frame + 3));
    mju_normalize3(frame + 3);
    mju_cross(frame + 6, frame, frame + 3);
    const std::array<double, 3> rate = motion_.point_rate(contact, When::kMiddle);
    contact.is_in_middle = true;
    contact.ahead = time_;
    for (int i = 0; i < 3; ++i) contact.turning[i] = (rate[i] - start_rate[i]) / time_;
    mju_copy(data_->contact[contact.source].frame, frame, 9);
    std::copy_n(rotation, 9, contact.rotation.begin());
  }

  mjModel* model_;
  mjData* data_;
  double time_;
  ContactInput *first_, *last_;
  ContactMotion motion_;
  double size_ = 0.0;     // m, radius about the smaller geom
  bool at_rest_ = false;  // its geoms, on each other
  bool is_far_ = false;   // they may come to another face up to the middle
  double way_ = 0.0;      // m, to the middle
};

}  // namespace

void take_to_middle(mjModel_* m, mjData_* d, double length, const Trees& trees,
                    const double* motion, FaceBuffers& faces, Workplaces& workplaces,
                    std::vector<ContactInput>& contacts, std::vector<char>& taken, Team& team) {
  const int count = static_cast<int>(contacts.size());
  const auto begins_pair = [&](int i) {
    return i == 0 || i == count || !contacts[i].is_of_pair(contacts[i - 1].geom);
  };
  workplaces.open(m, d, &faces, count > kContactsAtOnce ? team.active() : 1);
  team.share(count, kContactsAtOnce, [&](int worker, int begin, int end) {
    const Workplace at(workplaces, worker);
    // Pairs that begin in the range.
    while (begin < end && !begins_pair(begin)) ++begin;
    for (int first = begin, last; first < end; first = last) {
      last = first + 1;
      while (!begins_pair(last)) ++last;
      TurningPair pair(at.model(), at.data(), 0.5 * length, contacts.data() + first,
                       contacts.data() + last);
      if (pair.moves(trees, motion))
        pair.take(*at.faces());
      else
        pair.turn_axes();
    }
  });
  workplaces.close();
  for (const ContactInput& contact : contacts)
    if (contact.is_in_middle)
      for (int tree : contact.tree)
        if (tree >= 0) taken[tree] = 1;
}

}  // namespace dashpot::host
