#include "far_pair.hpp"

#include <cmath>

#include "dashpot/detect/geom_faces.hpp"
#include "side_by_side.hpp"

namespace dashpot::host {

namespace {

// Way in a step, relative to the size of the smaller geom, up to which a pair meets where it did.
constexpr double kFarWay = 0.1;
// How far off, relative to the same, what rolls or slides along still is.
constexpr double kNear = 0.5 * kFarWay;

// Change of the cosine of a normal to the axis of a round side up to which it is along one line.
constexpr double kSameLine = 1e-3;
// Gap rate up to which a pair runs along, as a fraction of sqrt(g r): what rests falls by a 200th
// of its radius until it is faster.
constexpr double kAlong = 0.095;

void to_local(const mjData* d, int geom, const mjtNum* direction, mjtNum* local) {
  mju_mulMatTVec3(local, d->geom_xmat + 9 * geom, direction);
}

}  // namespace

bool FarPair::find(const mjData* d, const ContactInput& contact) {
  size_ = motion_.size();
  is_far_ = motion_.geom_type(0) != mjGEOM_PLANE && motion_.way() > kFarWay * size_;
  if (!is_far_) return true;
  if (!runs_along(contact)) return false;
  mjtNum normal[2][3];
  for (int side = 0; side < 2; ++side)
    to_local(d, motion_.geom(side), contact.frame.data(), normal[side]);
  on_round_ = touches_round(normal[0], normal[1]);
  return true;
}

bool FarPair::follows(const mjData* d, const ContactInput& start, const SeenContact& seen,
                      const IsolatedPairs& pairs, double length) const {
  if (start.continued >= 0 && is_past_end(d, start, seen)) return false;
  if (!is_far_) return true;
  if (on_round_ && touches_round(seen.local_normal[0], seen.local_normal[1])) return true;
  return start.gap <= kNear * size_ && runs_along(start) && pairs.is_alone(start, length);
}

// Not into or out of each other.
bool FarPair::runs_along(const ContactInput& contact) const {
  return std::abs(motion_.gap_rate(contact)) < kAlong * std::sqrt(motion_.gravity() * size_);
}

bool FarPair::touches_round(const mjtNum* local_normal1, const mjtNum* local_normal2) const {
  return motion_.is_round_along(0, local_normal1) && motion_.is_round_along(1, local_normal2);
}

bool FarPair::is_past_end(const mjData* d, const ContactInput& start,
                          const SeenContact& seen) const {
  const int side = start.continued, type = motion_.geom_type(side);
  mjtNum normal[3];
  to_local(d, motion_.geom(side), start.frame.data(), normal);
  if (has_round_side(type) && std::abs(normal[2]) < kSameLine)
    return std::abs(seen.local_normal[side][2] - normal[2]) > kSameLine;
  return has_faces(type) && mju_dot3(normal, seen.local_normal[side]) < kOfFace;
}

}  // namespace dashpot::host
