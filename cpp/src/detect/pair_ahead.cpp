#include "pair_ahead.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace dashpot::host {

namespace {

// How far, relative to the size of the smaller geom, a contact point moves on along a rim or a
// surface up to the middle: that of a disc that has almost come to rest runs around it faster than
// steps can follow.
constexpr double kFarPoint = 0.5;
// 1 - cos of the angle between the normals of one contact at the start and in the middle, at most;
// at other times it goes with the square of the time.
constexpr double kMostTurnOfNormal = 0.15;

}  // namespace

void PairAhead::look(double time, FaceBuffers& faces, double apart) {
  time_ = time;
  way_ = motion_.way_in(std::abs(time));
  const double reach = first_->margin + way_ + apart;
  seen_.find(model_, data_, time, reach, faces);
  motion_.find_twists(time);
}

ContactInput* PairAhead::find(const ContactInput& contact, bool is_round_hit) {
  const SeenContact* const same = continuation(contact);
  if (!same) return nullptr;
  const double part = is_round_hit ? 1.0 : std::min(1.0, std::abs(time_) / (0.5 * length_));
  const double far = motion_.have_corners() ? 2.0 * way_ : part * kFarPoint * motion_.size();
  if (squared_distance_on_geoms(contact, *same) > far * far) return nullptr;
  if (1.0 - mju_dot3(same->normal, contact.frame.data()) > part * part * kMostTurnOfNormal)
    return nullptr;
  if (!is_round_hit && !far_.follows(data_, contact, *same, pairs_, length_)) return nullptr;
  then_ = seen_in(*same, time_, contact);
  find_turning(contact, then_);
  return &then_;
}

ContactInput* PairAhead::find_coming(const ContactInput& contact) {
  const SeenContact* const same = continuation(contact);
  if (!same) return nullptr;
  then_ = seen_in(*same, time_, contact);
  then_.gap = same->distance - contact.margin;
  return &then_;
}

const SeenContact* PairAhead::continuation(const ContactInput& contact) const {
  const SeenContact* const same = seen_.continuation(contact);
  return same && seen_.start_of(*same, first_, last_) == &contact ? same : nullptr;
}

ContactInput PairAhead::seen_in(const SeenContact& seen, double time, ContactInput contact) const {
  const double apart = std::max(0.0, seen.distance - contact.margin);
  mjtNum point[2][3];
  for (int i = 0; i < 2; ++i) {
    mju_addScl3(point[i], seen.position, seen.normal, (i == 0 ? -0.5 : 0.5) * apart);
    if (motion_.is_free(i)) mju_addToScl3(point[i], motion_.linear(i), -time);
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
  contact.ahead = time;
  std::copy_n(seen_.rotation(), 9, contact.rotation.begin());
  return contact;
}

void PairAhead::find_turning(const ContactInput& start, ContactInput& contact) const {
  const std::array<double, 3> before = motion_.point_rate(start, ContactMotion::When::kStart),
                              then = motion_.point_rate(contact, ContactMotion::When::kThen);
  for (int i = 0; i < 3; ++i) contact.turning[i] = (then[i] - before[i]) / time_;
}

}  // namespace dashpot::host
