#include "dashpot/detection/coming.hpp"

#include <algorithm>

#include "dashpot/detection/side_by_side.hpp"

namespace dashpot::host {

namespace {

// Cosine between the normals of a contact to come and of the one found: convex bodies meet along
// one.
constexpr double kNormalAlike = 0.85;
// Fraction of its depth that a contact known nearby goes in by where it stands for it.
constexpr double kStandsAsDeep = 0.8;
// Fraction of the radius up to which a contact moves along a rim or around a side in a step, as
// that of what rolls.
constexpr double kAlongRound = 0.5;

// Least radius of round sides and rims of two geoms, as far as the other one reaches; 0 where
// neither has any.
mjtNum round_radius(const mjModel* m, int geom1, int geom2) {
  mjtNum least = 0.0;
  for (int geom : {geom1, geom2}) {
    if (!has_round_side(m->geom_type[geom])) continue;
    const mjtNum reach = m->geom_rbound[geom == geom1 ? geom2 : geom1];
    const mjtNum radius = std::min(m->geom_size[3 * geom], reach);
    least = least > 0.0 ? std::min(least, radius) : radius;
  }
  return least;
}

}  // namespace

ComingContacts::ComingContacts(const mjModel* m, mjData* d, int geom1, int geom2,
                               const mjtNum* body_velocity)
    : along_round_(kAlongRound * round_radius(m, geom1, geom2)),
      moved1_(m, d, geom1, m->opt.timestep, Spin::kOfShape, body_velocity),
      moved2_(m, d, geom2, m->opt.timestep, Spin::kOfShape, body_velocity) {}

mjtNum ComingContacts::gap_at_end(const mjPreContact& contact) const {
  mjtNum end1[3], end2[3], way[3];
  mju_copy3(end1, contact.pos);
  mju_copy3(end2, contact.pos);
  moved1_.move_on(end1);
  moved2_.move_on(end2);
  mju_sub3(way, end2, end1);
  return contact.dist + mju_dot3(way, contact.normal);
}

int ComingContacts::add(const mjPreContact* end, int end_count, mjtNum margin, int most,
                        mjPreContact* contact, int count) const {
  const int known = count;
  for (int i = 0; i < end_count && count < most; ++i) {
    if (mju_dot3(end[i].normal, contact[0].normal) < kNormalAlike) continue;
    mjtNum surface1[3], surface2[3], apart[3];
    mju_addScl3(surface1, end[i].pos, end[i].normal, -0.5 * end[i].dist);
    mju_addScl3(surface2, end[i].pos, end[i].normal, 0.5 * end[i].dist);
    moved1_.move_back(surface1);
    moved2_.move_back(surface2);
    mju_sub3(apart, surface2, surface1);
    mjPreContact& c = contact[count];
    c.dist = mju_dot3(apart, end[i].normal);
    if (c.dist <= 0.0 || c.dist > margin) continue;
    mju_add3(c.pos, surface1, surface2);
    mju_scl3(c.pos, c.pos, 0.5);
    // Two contacts at one place would be twice as stiff and damped. Near: as far as geoms may move.
    const auto stands_for_it = [&](const mjPreContact& of_start) {
      const mjtNum way = mju_dist3(of_start.pos, c.pos);
      return way < along_round_ ||
             (way < margin && gap_at_end(of_start) < kStandsAsDeep * end[i].dist);
    };
    if (std::any_of(contact, contact + known, stands_for_it)) continue;
    mju_copy3(c.normal, end[i].normal);
    mju_zero3(c.tangent);
    ++count;
  }
  return count;
}

}  // namespace dashpot::host
