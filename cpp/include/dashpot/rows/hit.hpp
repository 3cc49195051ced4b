// What is a hit, and when within a step its force acts.
//
// A body that comes with the closing speed c upon an undamped spring of the frequency
// omega = sqrt(k w), which it has compressed by x, swings through the phase
//
//     phi = atan2(omega x, c)
//
// up to the release at pi, under a force in proportion to sin(phi + omega t). Over a time e the
// centre of that force is, with s = omega e / 2,
//
//     (s + cot(phi + s) (1 - s cot s)) / omega .
//
// It lies two thirds of a short time after the onset (phi = 0), and in the middle of all. Under an
// acceleration b of the gap, as that by which the turn of normals opens it, the spring swings so
// about the place x = -b / omega^2, from which x counts in phi; and is released earlier, at
// pi - asin(b / (omega^2 X)), X being the swing: the force has its centre where
//
//     (P c - b e^2 / (2 omega^2)) / (P - b e / omega^2),   P = 2 X / omega sin(phi + s) sin(s),
//
// c being the centre above.

#pragma once

#include <array>
#include <functional>

#include "dashpot/law/constants.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// What a contact or limit is in a step.
enum class Hit : char {
  kNone,
  kNow,    // hit in it
  kBefore  // hit in the step before, and still thrown back
};

// sqrt(k w) (rad/s) of a contact of the apparent inverse mass w (1/kg).
using HitFrequency = std::function<double(const ContactInput& contact, double inverse_mass)>;

// Gap rate (m/s or rad/s) from which on a contact or limit is hit rather than pressed, where that
// is more than smooth forces, or the turn of its geometry, make in two steps, or where it was open
// and closes at that rate. Corners that hit more slowly leave with 17 % of the impulse wrong, not
// 8; with 5 mm/s a pile at rest passed for hit. Of contacts in a model's own unit of length
// (Rows::metre); a limit has the same number in rad/s.
inline constexpr double kHitSpeed = 0.02;
inline double hit_speed(const Rows& rows, const RowGroup& group) {
  return group.kind == RowKind::kContact ? kHitSpeed * rows.metre : kHitSpeed;
}
// How many times the load of smooth forces the spring of what is hit bears.
inline constexpr double kHitLoads = 4.0;
// A hit is short in a step whose length times omega is more than this: it lasts no longer than the
// step. Longer ones go by the geometry of every step, whose errors are of second order; but those
// of round bodies, see detect/pair_hits.hpp.
inline constexpr double kShortHit = kPi;
inline bool is_short_hit(double stiffness, double inverse_mass, double step) {
  return stiffness * inverse_mass * step * step > kShortHit * kShortHit;
}

// Centre (s) of the force of a hit over the next `time` (s), less if it is released before.
// `frequency` (rad/s, > 0), `compression` (m, >= 0), `closing_speed` (m/s, negative where it opens;
// not 0 where `compression` is), `acceleration` (m/s^2) of the gap without the force.
double centre_of_hit(double frequency, double compression, double closing_speed,
                     double acceleration, double time);

// Whether two contacts are between the same two trees, one of which may be the ground.
bool joins_same_trees(const std::array<int, 2>& a, const std::array<int, 2>& b);

// When (s) a gap (m) closes at a speed (m/s): 0 if closed, infinite if not within `length` (s).
double onset_in(double length, double gap, double closing_speed);

// When a hit that begins at `onset` (s) is at its deepest: a quarter of a period later.
double deepest_of_hit(double onset, double frequency);

// Whether a contact that begins at `onset` (s, infinite if not in the step) touches a body that
// another one hits, deepest at `deepest` (s): before that, or from another side. What comes later
// from the same side finds that the body has turned back. Normals out of what pushes the body.
bool disturbs_hit(double onset, const std::array<double, 3>& normal,
                  const std::array<double, 3>& normal_of_hit, double deepest);

}  // namespace dashpot
