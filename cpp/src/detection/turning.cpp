#include "dashpot/detection/turning.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "dashpot/detection/contact_motion.hpp"
#include "dashpot/detection/far_pair.hpp"
#include "dashpot/detection/lone_pairs.hpp"
#include "dashpot/detection/pair_hits.hpp"
#include "dashpot/detection/seen_contacts.hpp"
#include "dashpot/detection/workplaces.hpp"
#include "dashpot/mujoco/properties.hpp"
#include "dashpot/rows/hit.hpp"

namespace dashpot::host {

namespace {

// Turn in a step (rad) up to which a pair is at rest, as kStillWay is for its way.
constexpr double kStillTurn = 1e-5;
// Fraction of its radius by which a ball on a plane comes closer in a step up to which its arm, all
// that changes there, is the same.
constexpr double kSameArm = 1e-3;
// How far, relative to the size of the smaller geom, a contact point moves on along a rim or a
// surface up to the middle: that of a disc that has almost come to rest runs around it faster than
// steps can follow.
constexpr double kFarPoint = 0.5;
// Fraction of the step within which a gap or an overlap that closes at its present rate is gone
// early.
constexpr double kEarly = 0.25;
// Fraction of the step, and of 1 / omega of a hit of round bodies, up to which two times see one
// geometry.
constexpr double kSameTime = 0.03;
// 1 - cos of the angle between the normals of one contact at the start and in the middle, at most;
// at other times it goes with the square of the time.
constexpr double kMostTurnOfNormal = 0.15;
// Most of the speed of a hit that the turn of its normal adds in the time 1 / omega.
constexpr double kMostOfTurn = 1.0;
// Fraction of the step in which the turn of a normal is lost in rounding.
constexpr double kSliver = 1e-6;
constexpr int kContactsAtOnce = 16;  // by a thread

// What pairs of geoms have in common over a step of `length` (s).
struct Step {
  double length;
  bool any_motion;  // none is rest
  const Trees& trees;
  const double* motion;  // velocities in motion coordinates
  const std::vector<double>& lead;
  const HitFrequency& frequency;
  const LonePairs& pairs;
  double hit_speed;  // m/s
};

// The contacts of two geoms over a step.
class TurningPair {
 public:
  // Of the contacts from `first` to `last`.
  TurningPair(mjModel* m, mjData* d, const Step& step, ContactInput* first, ContactInput* last)
      : model_(m),
        data_(d),
        step_(step),
        first_(first),
        last_(last),
        lead_(mean_of_trees(first->tree, step.lead)),
        motion_(m, d, step.length),
        hits_(motion_, step.trees, step.frequency, step.pairs, step.length, lead_, step.hit_speed),
        far_(motion_),
        found_(motion_, step.length),
        same_time_(kSameTime * step.length) {}

  // Finds how the pair moves; whether it does, and may touch up to the middle or is hit.
  bool moves() {
    if (!motion_.find(*first_, step_.trees, step_.motion)) return false;
    const bool on_plane = motion_.geom_type(0) == mjGEOM_PLANE;
    size_ = motion_.size();
    if (on_plane && motion_.is_free_ball(1) && !changes_arm()) return false;
    at_rest_ =
        !step_.any_motion && motion_.turn() <= kStillTurn && motion_.way() <= kStillWay * size_;
    if (at_rest_) return false;
    const double frequency = motion_.are_round() ? hits_.frequency(*first_) : 0.0;
    is_round_hit_ = frequency > 0.0 && hits_.is_soft(*first_);
    if (is_round_hit_) same_time_ = std::min(same_time_, kSameTime / frequency);
    if (first_->frozen == Frozen::kAtImpact) return is_round_hit_;
    goes_far_ = !far_.find(data_, *first_);
    if (is_round_hit_) return true;
    if (goes_far_ || (motion_.are_round() && parts_early() && frequency == 0.0)) return false;
    const double to_middle = motion_.way_in(middle());
    return std::any_of(first_, last_, [&](const ContactInput& c) {
      return c.gap <= to_middle || hits_.frequency(c) > 0.0;
    });
  }

  // Of a pair whose contacts stay where they are, takes to the middle the axes of the joints that
  // hold it there: those of a leg turn though its foot stands.
  void turn_axes() {
    if (!at_rest_ || !(motion_.joints_move(0, kStillTurn) || motion_.joints_move(1, kStillTurn)))
      return;
    motion_.find_twists(middle());
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      if (contact->gap > 0.0) continue;
      const std::array<double, 3> start = motion_.point_rate(*contact, When::kStart),
                                  then = motion_.point_rate(*contact, When::kThen);
      mjtNum change[3];
      mju_sub3(change, then.data(), start.data());
      if (step_.length * mju_norm3(change) <= kStillTurn * kStillWay * size_) continue;
      contact->ahead = middle();
      for (int i = 0; i < 3; ++i) contact->turning[i] = change[i] / contact->ahead;
    }
  }

  // Takes the contacts that are found there to the middle of the step, or of their hit.
  void take(FaceBuffers& faces) {
    if (first_->frozen == Frozen::kAtImpact) return take_on_from_impact(faces, *first_);
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      // At a seam the middle may be beyond the edge, where the other geom's face goes on.
      if (contact->is_at_seam()) continue;
      const double frequency = hits_.frequency(*contact);
      const bool comes = frequency > 0.0 && contact->gap > 0.0;
      const bool goes_on = frequency > 0.0 && hits_.compression(*contact) > 0.0;
      const double at = middle() - lead_;
      const auto hit_time = [&](double acceleration) {
        return hits_.time(*contact, frequency, acceleration, seen_at_);
      };
      contact->is_of_round_hit = goes_on;
      if (!see(faces, *contact, comes || goes_on ? hit_time(0.0) : at)) continue;
      if (frequency > 0.0) {
        // As it turns, its gap closes at another rate.
        const double rate = motion_.point_rate(then_, When::kStart)[0], turning = then_.turning[0];
        const bool rolls = hits_.rolls(*contact, frequency, rate, turning);
        if (rolls && is_round_hit_ && (goes_far_ || parts_early())) continue;
        contact->is_of_round_hit = is_round_hit_ && !rolls;
        if (!see(faces, *contact, rolls ? at : hit_time(turning))) continue;
      }
      freeze(then_, *contact);
      mju_copy(data_->contact[contact->source].frame, contact->frame.data(), 9);
    }
  }

 private:
  using When = ContactMotion::When;

  double middle() const { return 0.5 * step_.length; }

  // Takes a contact of two round bodies that fly, which is that of their impact, on to where the
  // force of the hit acts. Its gap closes when it did.
  void take_on_from_impact(FaceBuffers& faces, ContactInput& contact) {
    const double frequency = hits_.frequency(contact), begins = hits_.onset(contact);
    const double closing = -motion_.gap_rate(contact);
    motion_.find_twists(begins);
    const std::array<double, 3> at_impact = motion_.point_rate(contact, When::kThen);
    double turning = 0.0;
    for (int pass = 0; pass < 2; ++pass) {
      const double after = centre_of_hit(frequency, 0.0, closing, turning, step_.length - begins);
      if (after <= kSliver * step_.length) return;
      seen_at_ = begins + after;
      look(faces);
      if (!find_then(contact)) return;
      const std::array<double, 3> rate = motion_.point_rate(then_, When::kThen);
      for (int i = 0; i < 3; ++i) then_.turning[i] = (rate[i] - at_impact[i]) / after;
      turning = then_.turning[0];
      // Another end of the two has come to be the nearest.
      if (std::abs(turning) > kMostOfTurn * closing * frequency) return;
      then_.gap =
          contact.gap + begins * (at_impact[0] - rate[0] - turning * (0.5 * begins - seen_at_));
    }
    contact.gap = then_.gap;
    contact.is_of_round_hit = true;
    freeze(then_, contact);
    mju_copy(data_->contact[contact.source].frame, contact.frame.data(), 9);
  }

  // Whether a ball comes or goes in a step that does not hold all of its hit.
  bool changes_arm() const {
    return step_.length * std::abs(motion_.gap_rate(*first_)) > kSameArm * size_ &&
           hits_.frequency(*first_) == 0.0;
  }

  // Whether a blow begins or ends early in the step, by how fast the gap changes.
  bool parts_early() const {
    const double rate = std::abs(motion_.gap_rate(*first_));
    return rate >= step_.hit_speed && std::abs(first_->gap) < kEarly * step_.length * rate;
  }

  // Finds what a contact is at a time (s), unless that is about the start, as which it stays; but
  // where places lead, the start is no more the time up to which nothing turns.
  bool see(FaceBuffers& faces, const ContactInput& contact, double time) {
    if (lead_ > 0.0)
      time = std::copysign(std::max(std::abs(time), 2.0 * same_time_), time);
    else if (time <= same_time_)
      return false;
    if (std::abs(time - seen_at_) > same_time_) {
      seen_at_ = time;
      look(faces);
    }
    return find_then(contact);
  }

  void look(FaceBuffers& faces) {
    way_ = motion_.way_in(std::abs(seen_at_));
    found_.find(model_, data_, seen_at_, first_->margin + way_, faces);
    motion_.find_twists(seen_at_);
  }

  // Finds what a contact is then, if it is there.
  bool find_then(const ContactInput& contact) {
    const SeenContact* const same = found_.continuation(contact);
    if (!same || found_.start_of(*same, first_, last_) != &contact) return false;
    const bool corners =
        has_corners(model_, motion_.geom(0)) && has_corners(model_, motion_.geom(1));
    const double part = is_round_hit_ ? 1.0 : std::min(1.0, std::abs(seen_at_) / middle());
    const double far = corners ? 2.0 * way_ : part * kFarPoint * size_;
    if (squared_distance_on_geoms(contact, *same) > far * far) return false;
    if (1.0 - mju_dot3(same->normal, contact.frame.data()) > part * part * kMostTurnOfNormal)
      return false;
    if (!is_round_hit_ && !far_.follows(data_, contact, *same, step_.pairs, step_.length))
      return false;
    then_ = seen_in(*same, contact);
    return true;
  }

  // A contact as it is seen then: each free body sees the point from where its centre of mass is at
  // the start; axes of joints and twists go there themselves.
  ContactInput seen_in(const SeenContact& seen, ContactInput contact) const {
    const std::array<double, 3> start_rate = motion_.point_rate(contact, When::kStart);
    const double apart = std::max(0.0, seen.distance - contact.margin);
    mjtNum point[2][3];
    for (int i = 0; i < 2; ++i) {
      mju_addScl3(point[i], seen.position, seen.normal, (i == 0 ? -0.5 : 0.5) * apart);
      if (motion_.is_free(i)) mju_addToScl3(point[i], motion_.linear(i), -seen_at_);
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
    const std::array<double, 3> rate = motion_.point_rate(contact, When::kThen);
    contact.ahead = seen_at_;
    for (int i = 0; i < 3; ++i) contact.turning[i] = (rate[i] - start_rate[i]) / seen_at_;
    std::copy_n(found_.rotation(), 9, contact.rotation.begin());
    return contact;
  }

  // Gives a contact the geometry that it has then; threads read its geoms meanwhile.
  static void freeze(const ContactInput& then, ContactInput& contact) {
    contact.position = then.position;
    contact.apart = then.apart;
    contact.frame = then.frame;
    contact.rotation = then.rotation;
    contact.frozen = Frozen::kAhead;
    contact.ahead = then.ahead;
    contact.turning = then.turning;
  }

  mjModel* model_;
  mjData* data_;
  const Step& step_;
  ContactInput *first_, *last_;
  double lead_;  // s, by which the places of the start are later than its velocities
  ContactMotion motion_;
  PairHits hits_;
  FarPair far_;
  double size_ = 0.0;     // m, radius about the smaller geom
  bool at_rest_ = false;  // its geoms, on each other
  bool is_round_hit_ = false, goes_far_ = false;
  // What was found at a time (s), up to which the pair moves by way_ (m), and a contact then.
  double seen_at_ = 0.0, way_ = 0.0;
  SeenContacts found_;
  double same_time_;  // s, by which two times may differ that see one geometry
  ContactInput then_;
};

}  // namespace

void freeze_contacts(mjModel_* m, mjData_* d, double length, bool any_motion, const Trees& trees,
                     const double* motion, const std::vector<double>& lead, FaceBuffers& faces,
                     Workplaces& workplaces, const HitFrequency& frequency, const Memory& memory,
                     std::vector<ContactInput>& contacts, std::vector<double>& tree_ahead,
                     Team& team) {
  const int count = static_cast<int>(contacts.size());
  const auto begins_pair = [&](int i) {
    return i == 0 || i == count || !contacts[i].is_of_pair(contacts[i - 1].geom);
  };
  const LonePairs pairs(m, d, length, trees, motion, memory, contacts);
  const Step step{length, any_motion, trees, motion, lead, frequency, pairs, kHitSpeed * metre(m)};
  workplaces.open(m, d, &faces, count > kContactsAtOnce ? team.active() : 1);
  team.share(count, kContactsAtOnce, [&](int worker, int begin, int end) {
    const Workplace at(workplaces, worker);
    // Pairs that begin in the range.
    while (begin < end && !begins_pair(begin)) ++begin;
    for (int first = begin, last; first < end; first = last) {
      last = first + 1;
      while (!begins_pair(last)) ++last;
      TurningPair pair(at.model(), at.data(), step, contacts.data() + first,
                       contacts.data() + last);
      if (pair.moves())
        pair.take(*at.faces());
      else
        pair.turn_axes();
    }
  });
  workplaces.close();
  for (const ContactInput& contact : contacts)
    if (contact.frozen == Frozen::kAhead)
      for (int tree : contact.tree)
        if (tree >= 0)
          tree_ahead[tree] = tree_ahead[tree] == 0.0 || tree_ahead[tree] == contact.ahead
                                 ? contact.ahead
                                 : 0.5 * length;
}

}  // namespace dashpot::host
