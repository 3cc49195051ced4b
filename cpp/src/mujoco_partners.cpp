#include "dashpot/mujoco_partners.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

namespace dashpot::host {

namespace {

// The box of bounds of a geom in the world.
struct Box {
  mjtNum centre[3], axis[3][3], half[3];
};

Box box_of(const mjModel* m, const mjData* d, int geom) {
  const mjtNum* bounds = m->geom_aabb + 6 * geom;
  const mjtNum* rotation = d->geom_xmat + 9 * geom;
  Box box;
  mju_mulMatVec3(box.centre, rotation, bounds);
  mju_addTo3(box.centre, d->geom_xpos + 3 * geom);
  for (int i = 0; i < 3; ++i) {
    box.half[i] = bounds[3 + i];
    for (int j = 0; j < 3; ++j) box.axis[i][j] = rotation[3 * j + i];
  }
  return box;
}

mjtNum extent(const Box& box, const mjtNum* direction) {
  mjtNum sum = 0.0;
  for (int i = 0; i < 3; ++i) sum += box.half[i] * std::abs(mju_dot3(box.axis[i], direction));
  return sum;
}

mjtNum height_over_plane(const mjModel* m, const mjData* d, int plane, int geom) {
  const Box box = box_of(m, d, geom);
  const mjtNum* rotation = d->geom_xmat + 9 * plane;
  const mjtNum normal[3] = {rotation[2], rotation[5], rotation[8]};
  mjtNum apart[3];
  mju_sub3(apart, box.centre, d->geom_xpos + 3 * plane);
  return mju_dot3(apart, normal) - extent(box, normal);
}

// The widest gap that a face of either leaves.
mjtNum boxes_apart(const Box& box1, const Box& box2) {
  mjtNum between[3], widest = -mjMAXVAL;
  mju_sub3(between, box2.centre, box1.centre);
  for (const Box* box : {&box1, &box2})
    for (const mjtNum* axis : {box->axis[0], box->axis[1], box->axis[2]})
      widest = std::max(
          widest, std::abs(mju_dot3(between, axis)) - extent(box1, axis) - extent(box2, axis));
  return widest;
}

bool is_excluded(const mjModel* m, int body1, int body2) {
  const int signature = (std::min(body1, body2) << 16) + std::max(body1, body2);
  return std::find(m->exclude_signature, m->exclude_signature + m->nexclude, signature) !=
         m->exclude_signature + m->nexclude;
}

// The filters of mj_collision: bits, bodies that are welded or next to each other, exclusions.
bool may_meet(const mjModel* m, int geom1, int geom2) {
  if (!(m->geom_contype[geom1] & m->geom_conaffinity[geom2]) &&
      !(m->geom_contype[geom2] & m->geom_conaffinity[geom1]))
    return false;
  const int body1 = m->geom_bodyid[geom1], body2 = m->geom_bodyid[geom2];
  const int weld1 = m->body_weldid[body1], weld2 = m->body_weldid[body2];
  if (weld1 == weld2 || is_excluded(m, body1, body2)) return false;
  if (m->opt.disableflags & mjDSBL_FILTERPARENT || weld1 == 0 || weld2 == 0) return true;
  const int parent1 = m->body_weldid[m->body_parentid[weld1]];
  const int parent2 = m->body_weldid[m->body_parentid[weld2]];
  return weld1 != parent2 && weld2 != parent1;
}

}  // namespace

double bounds_apart(const mjModel_* m, const mjData_* d, int geom1, int geom2) {
  if (m->geom_type[geom1] == mjGEOM_PLANE) return height_over_plane(m, d, geom1, geom2);
  if (m->geom_type[geom2] == mjGEOM_PLANE) return height_over_plane(m, d, geom2, geom1);
  const mjtNum spheres = mju_dist3(d->geom_xpos + 3 * geom1, d->geom_xpos + 3 * geom2) -
                         m->geom_rbound[geom1] - m->geom_rbound[geom2];
  return std::max(spheres, boxes_apart(box_of(m, d, geom1), box_of(m, d, geom2)));
}

void find_partners(const mjModel_* m, int geom, std::vector<Partner>& partners) {
  partners.clear();
  if (m->opt.disableflags & (mjDSBL_CONTACT | mjDSBL_CONSTRAINT)) return;
  for (int other = 0; other < m->ngeom; ++other)
    if (may_meet(m, geom, other))
      partners.push_back({other, m->geom_margin[geom] + m->geom_margin[other]});
  for (int pair = 0; pair < m->npair; ++pair) {
    const int geom1 = m->pair_geom1[pair], geom2 = m->pair_geom2[pair];
    if (geom == geom1) partners.push_back({geom2, m->pair_margin[pair]});
    if (geom == geom2) partners.push_back({geom1, m->pair_margin[pair]});
  }
}

bool comes_to_limit(const mjModel_* m, const mjData_* d, const std::vector<double>& mean_velocity,
                    double length, ReachBuffers& reach) {
  if (m->opt.disableflags & (mjDSBL_LIMIT | mjDSBL_CONSTRAINT)) return false;
  bool comes = false;
  for (int joint = 0; joint < m->njnt; ++joint) {
    const int type = m->jnt_type[joint], dof = m->jnt_dofadr[joint];
    if (!m->jnt_limited[joint] || (type != mjJNT_HINGE && type != mjJNT_SLIDE)) continue;
    const double way = length * mean_velocity[dof], margin = m->jnt_margin[joint];
    if (std::abs(way) <= reach.dof_reach[dof]) continue;
    const double* range = m->jnt_range + 2 * joint;
    const double at = d->qpos[m->jnt_qposadr[joint]];
    const double apart = way > 0.0 ? range[1] - at : at - range[0];
    if (apart < margin + reach.dof_reach[dof] || apart - std::abs(way) >= margin) continue;
    reach.least_dof_reach[dof] = std::abs(way);
    comes = true;
  }
  return comes;
}

}  // namespace dashpot::host
