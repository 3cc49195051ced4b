#include "dashpot/detect/turning.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "contact_motion.hpp"
#include "dashpot/detect/scratch.hpp"
#include "pair_ahead.hpp"
#include "pair_hits.hpp"

namespace dashpot::host {

namespace {

using When = ContactMotion::When;

constexpr int kContactsAtOnce = 16;  // by a thread
// Turn in a step (rad) up to which a pair is at rest, as kStillWay is for its way.
constexpr double kStillTurn = 1e-5;
// Fraction of its radius by which a ball on a plane comes closer in a step up to which its arm, all
// that changes there, is the same.
constexpr double kSameArm = 1e-3;
// Fraction of the step within which a gap or overlap that closes at its present rate is gone early.
constexpr double kEarly = 0.25;
// Fraction of the step, and of 1 / omega of a round hit, up to which two times see one geometry.
constexpr double kSameTime = 0.03;
// Most of the speed of a hit that the turn of its normal adds in the time 1 / omega.
constexpr double kMostOfTurn = 1.0;
// What comes on: within how much of its way in the step, as other contacts may change its speed;
// which fraction of its closing speed it loses up to where the plane of the start is met where its
// way bends; the gap, relative to the size of the smaller geom, at which it has arrived, and the
// closing speed, relative to that of hits, at which it passes.
constexpr double kMayMeet = 2.0, kBent = 0.1, kMet = 1e-6, kPasses = 0.25;
// Way in a step, relative to the radius of the thinner geom, up to which what comes on is followed.
// Farther on it leads through what stops it before, to the side of the next tile, and what is
// thrown off it within the step is stopped by nothing: thin rods left bins by their walls.
constexpr double kFollowed = 1.25;
// A way that only grazes takes half of what is left of its closing speed at each.
constexpr int kMostLooks = 10;
// Cosine between normals that are the same to a ball: 1.4 mrad.
constexpr double kSameNormal = 1.0 - 1e-6;
// Fraction of the step in which the turn of a normal is lost in rounding.
constexpr double kSliver = 1e-6;

// The contacts of two geoms that may turn in a step: whether they do, and the time at which each of
// them is frozen, as pair_ahead.hpp sees it then.
class TurningPair {
 public:
  // Of the contacts from `first` to `last`.
  TurningPair(mjModel* m, mjData* d, const TurningStep& step, const IsolatedPairs& pairs,
              ContactInput* first, ContactInput* last)
      : data_(d),
        step_(step),
        first_(first),
        last_(last),
        hit_speed_(pairs.hit_speed()),
        motion_(m, d, step.length),
        hits_(motion_, step, pairs),
        ahead_(m, d, motion_, pairs, step.length, first, last) {}

  // Finds how the pair moves; whether it does, and may touch up to the middle or is hit.
  bool moves() {
    if (!motion_.find(*first_, step_)) return false;
    const bool on_plane = motion_.geom_type(0) == mjGEOM_PLANE;
    size_ = motion_.size();
    if (on_plane && motion_.is_free_ball(1) && !changes_arm()) return false;
    at_rest_ =
        !step_.any_motion && motion_.turn() <= kStillTurn && motion_.way() <= kStillWay * size_;
    if (at_rest_) return false;
    const double frequency = motion_.are_round() ? hits_.frequency(*first_) : 0.0;
    is_round_hit_ = frequency > 0.0 && hits_.is_soft(*first_);
    same_time_ = kSameTime * step_.length;
    if (is_round_hit_) same_time_ = std::min(same_time_, kSameTime / frequency);
    if (first_->frozen == Frozen::kAtImpact) return is_round_hit_;
    goes_far_ = !are_soft_balls() && !ahead_.may_be_followed();
    if (is_round_hit_) return true;
    stays_ = goes_far_ || (motion_.are_round() && parts_early() && frequency == 0.0);
    if (stays_) return std::any_of(first_, last_, [&](const ContactInput& c) { return comes(c); });
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

  // Freezes the contacts that are found there in the middle of the step, or of their hit.
  void freeze(FaceBuffers& faces) {
    if (first_->frozen == Frozen::kAtImpact) return freeze_after_impact(faces, *first_);
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      if (comes(*contact) && freeze_where_it_is_met(faces, *contact)) continue;
      // At an internal edge the middle may be beyond the edge, where the other geom's face goes on.
      if (stays_ || contact->is_at_internal_edge()) continue;
      if (const ContactInput* then = in_its_time(faces, *contact)) take_geometry(*then, *contact);
    }
  }

 private:
  double middle() const { return 0.5 * step_.length; }
  // Whether two balls hit each other for as long as their springs swing: they have no edge to be
  // past by the middle, and their normal turns all the while, also where others touch them.
  bool are_soft_balls() const {
    return motion_.geom_type(0) == mjGEOM_SPHERE && motion_.geom_type(1) == mjGEOM_SPHERE &&
           hits_.is_soft(*first_);
  }

  // Whether a ball comes or goes in a step that does not hold all of its hit.
  bool changes_arm() const {
    return step_.length * std::abs(motion_.gap_rate(*first_)) > kSameArm * size_ &&
           hits_.frequency(*first_) == 0.0;
  }

  // Whether a blow begins or ends early in the step, by how fast the gap changes.
  bool parts_early() const {
    const double rate = std::abs(motion_.gap_rate(*first_));
    return rate >= hit_speed_ && std::abs(first_->gap) < kEarly * step_.length * rate;
  }

  // What a contact is at a time (s); null if it is not there, or if that is about the start.
  ContactInput* seen_at(FaceBuffers& faces, const ContactInput& contact, double time) {
    if (time <= same_time_) return nullptr;
    if (std::abs(time - ahead_.time()) > same_time_) ahead_.look(time, faces);
    return ahead_.find(contact, is_round_hit_);
  }

  // What a contact is in the middle of the step, or of its hit; null if not there, or if it stays.
  const ContactInput* in_its_time(FaceBuffers& faces, ContactInput& contact) {
    const double frequency = hits_.frequency(contact);
    const bool comes = frequency > 0.0 && contact.gap > 0.0;
    const bool goes_on = frequency > 0.0 && hits_.compression(contact) > 0.0;
    const auto hit_time = [&](double acceleration) {
      return hits_.time(contact, frequency, acceleration, ahead_.time());
    };
    contact.is_of_round_hit = goes_on;
    const ContactInput* const then =
        seen_at(faces, contact, comes || goes_on ? hit_time(0.0) : middle());
    if (!then || frequency == 0.0) return then;
    // As it turns, its gap closes at another rate.
    const double rate = motion_.point_rate(*then, When::kStart)[0], turning = then->turning[0];
    const bool rolls = hits_.rolls(contact, frequency, rate, turning);
    if (rolls && is_round_hit_ && (goes_far_ || parts_early())) return nullptr;
    contact.is_of_round_hit = is_round_hit_ && !rolls;
    return seen_at(faces, contact, rolls ? middle() : hit_time(turning));
  }

  // Takes a contact of two round bodies that fly, which is that of their impact, on to where the
  // force of the hit acts. Its gap closes when it did.
  void freeze_after_impact(FaceBuffers& faces, ContactInput& contact) {
    const double frequency = hits_.frequency(contact), begins = hits_.onset(contact);
    const double closing = -motion_.gap_rate(contact);
    motion_.find_twists(begins);
    const std::array<double, 3> at_impact = motion_.point_rate(contact, When::kThen);
    ContactInput* then = nullptr;
    double turning = 0.0;
    for (int pass = 0; pass < 2; ++pass) {
      const double after = centre_of_hit(frequency, 0.0, closing, turning, step_.length - begins);
      if (after <= kSliver * step_.length) return;
      ahead_.look(begins + after, faces);
      then = ahead_.find(contact, is_round_hit_);
      if (!then) return;
      const std::array<double, 3> rate = motion_.point_rate(*then, When::kThen);
      for (int i = 0; i < 3; ++i) then->turning[i] = (rate[i] - at_impact[i]) / after;
      turning = then->turning[0];
      // Another end of the two has come to be the nearest.
      if (std::abs(turning) > kMostOfTurn * closing * frequency) return;
      then->gap = contact.gap +
                  begins * (at_impact[0] - rate[0] - turning * (0.5 * begins - ahead_.time()));
    }
    contact.gap = then->gap;
    contact.is_of_round_hit = true;
    take_geometry(*then, contact);
  }

  // Whether a contact is apart, and may be met at the plane that it has at the start; planes and
  // the sides of height fields are there wherever they are met.
  bool comes(const ContactInput& contact) const {
    const int type = motion_.geom_type(0);
    if (contact.gap <= 0.0 || is_round_hit_ || type == mjGEOM_PLANE || type == mjGEOM_HFIELD)
      return false;
    if (motion_.way() > kFollowed * motion_.thickness()) return false;
    const double closing = -motion_.gap_rate(contact);
    return closing > hit_speed_ && contact.gap < kMayMeet * step_.length * closing;
  }

  // Whether a ball comes upon another normal than at the start, along which it would leave beside
  // the way by as much. Corners meet along normals of their own.
  bool normal_turns(const ContactInput& then, const ContactInput& contact) const {
    return (motion_.is_ball(0) || motion_.is_ball(1)) &&
           mju_dot3(then.frame.data(), contact.frame.data()) < kSameNormal;
  }

  // Freezes a contact that comes on where it is met, or where it passes, with the gap that leads
  // there. Returns whether the way there bends, or the normal turns; else it stays as it is. So
  // does a corner that is met: another one may come to be the nearest.
  bool freeze_where_it_is_met(FaceBuffers& faces, ContactInput& contact) {
    double time = 0.0, gap = contact.gap, closing = -motion_.gap_rate(contact);
    ContactInput met;
    for (int looks = 0; looks < kMostLooks && time < step_.length; ++looks) {
      const double next = std::min(step_.length, time + gap / closing);
      ahead_.look(next, faces, contact.gap);
      const ContactInput* const then = ahead_.find_coming(contact);
      if (!then) break;
      const double closing_then = -motion_.point_rate(*then, When::kThen)[0];
      if (looks == 0 && closing_then > (1.0 - kBent) * closing && !normal_turns(*then, contact))
        return false;
      met = *then;
      time = next;
      gap = then->gap;
      closing = closing_then;
      if (gap <= kMet * size_ || closing <= kPasses * hit_speed_) break;
    }
    if (time == 0.0 || (gap <= kMet * size_ && motion_.have_corners())) return false;
    met.turning = {};
    take_geometry(met, contact);
    contact.gap = gap + closing * time;
    return true;
  }

  // Gives a contact the geometry that it has then; threads read its geoms meanwhile.
  void take_geometry(const ContactInput& then, ContactInput& contact) {
    contact.position = then.position;
    contact.apart = then.apart;
    contact.frame = then.frame;
    contact.rotation = then.rotation;
    contact.frozen = Frozen::kAhead;
    contact.ahead = then.ahead;
    contact.turning = then.turning;
    mju_copy(data_->contact[contact.source].frame, contact.frame.data(), 9);
  }

  mjData* data_;
  const TurningStep& step_;
  ContactInput *first_, *last_;
  double hit_speed_;  // m/s
  ContactMotion motion_;
  PairHits hits_;
  PairAhead ahead_;
  double size_ = 0.0;       // m, radius about the smaller geom
  double same_time_ = 0.0;  // s, by which two times may differ that see one geometry
  bool at_rest_ = false;    // its geoms, on each other
  bool is_round_hit_ = false, goes_far_ = false;
  bool stays_ = false;  // but for contacts that come
};

}  // namespace

void freeze_contacts(mjModel_* m, mjData_* d, const TurningStep& step, FaceBuffers& faces,
                     Scratch& scratch, std::vector<ContactInput>& contacts,
                     std::vector<double>& tree_ahead, Team& team) {
  const int count = static_cast<int>(contacts.size());
  const auto begins_pair = [&](int i) {
    return i == 0 || i == count || !contacts[i].is_of_pair(contacts[i - 1].geom);
  };
  const IsolatedPairs pairs(m, d, step, contacts);
  scratch.open(m, d, &faces, count > kContactsAtOnce ? team.active() : 1);
  team.share(count, kContactsAtOnce, [&](int worker, int begin, int end) {
    const WorkerScratch at(scratch, worker);
    // Pairs that begin in the range.
    while (begin < end && !begins_pair(begin)) ++begin;
    for (int first = begin, last; first < end; first = last) {
      last = first + 1;
      while (!begins_pair(last)) ++last;
      TurningPair pair(at.model(), at.data(), step, pairs, contacts.data() + first,
                       contacts.data() + last);
      if (pair.moves())
        pair.freeze(*at.faces());
      else
        pair.turn_axes();
    }
  });
  scratch.close();
  for (const ContactInput& contact : contacts) {
    if (contact.frozen != Frozen::kAhead) continue;
    for (int tree : contact.tree) {
      if (tree < 0) continue;
      double& ahead = tree_ahead[tree];
      ahead = ahead == 0.0 || ahead == contact.ahead ? contact.ahead : 0.5 * step.length;
    }
  }
}

}  // namespace dashpot::host
