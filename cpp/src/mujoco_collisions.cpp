#include "dashpot/mujoco_collisions.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco_faces.hpp"
#include "dashpot/mujoco_moved_geom.hpp"
#include "dashpot/mujoco_side_by_side.hpp"
#include "dashpot/mujoco_terrain.hpp"

// Exported by the pinned MuJoCo library though not declared in its public headers: the collision of
// any two convex geoms.
extern "C" int mjc_Convex(const mjModel* m, mjData* d, mjPreContact* con, int g1, int g2,
                          mjtNum margin);

namespace dashpot::host {

namespace {

// Part of the least half-width: a wider reach needs contacts of boxes that meet at a corner.
constexpr double kFarReach = 0.005;
// The same above which points that are not nearest count: below, they go in by less in a step.
// Round meshes, whose corners land one after the other, would roll for ever on what that leaves.
constexpr double kFastReach = 0.05;
constexpr double kFastReachOfMesh = 0.0005;
// Types whose pairs meet in more than one point.
constexpr int kExtended[] = {mjGEOM_CAPSULE, mjGEOM_CYLINDER, mjGEOM_BOX, mjGEOM_MESH};
// Cosine between the normals of such a point and of the contact found: convex bodies meet along
// one.
constexpr double kAlike = 0.85;
// Cosine between the normals of a face and of a contact on it.
constexpr double kOfFace = 0.999999;
// Part of such a point's depth that a contact known nearby goes in by where it stands for it.
constexpr double kAsDeep = 0.8;
// Part of the radius up to which a contact moves along a rim or around a side in a step, as that of
// what rolls.
constexpr double kAlongRound = 0.5;
// Tilt (rad) below which a cylinder stands flat on a plane. MuJoCo's distances are good to 1e-9
// radii above it.
constexpr double kFlat = 1e-6;
constexpr double kSearchTolerance = 1e-9;              // m, of the distance that a search ends with
const double kThirdTurn[2] = {-0.5, std::sqrt(0.75)};  // cosine and sine

thread_local mjModel* replaced = nullptr;  // the model whose collisions are
thread_local FaceBuffers* face_buffers = nullptr;
mjfCollision collide_now[mjNGEOMTYPES][mjNGEOMTYPES] = {}, collide_cylinder = nullptr;

// A column of a rotation matrix.
void column_of(const mjtNum* rotation, int column, mjtNum* out) {
  for (int i = 0; i < 3; ++i) out[i] = rotation[3 * i + column];
}

// Whether two geoms may adhere: pulls of adhesion act in the points that MuJoCo finds.
bool may_adhere(const mjModel* m, int geom1, int geom2) {
  return m->flg_adhesion &&
         (m->npair > 0 || m->geom_adhesion[geom1] != 0.0 || m->geom_adhesion[geom2] != 0.0);
}

// Least half-width of a geom's box of bounds.
mjtNum half_width(const mjModel* m, int geom) {
  const mjtNum* half = m->geom_aabb + 6 * geom + 3;
  return std::min({half[0], half[1], half[2]});
}

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

// Gap that a contact will have at the end of the step.
mjtNum gap_at_end(const mjPreContact& contact, const MovedGeom& moved1, const MovedGeom& moved2) {
  mjtNum end1[3], end2[3], way[3];
  mju_copy3(end1, contact.pos);
  mju_copy3(end2, contact.pos);
  moved1.move_on(end1);
  moved2.move_on(end2);
  mju_sub3(way, end2, end1);
  return contact.dist + mju_dot3(way, contact.normal);
}

// Adds points that are apart now and overlap at the end of the step, at the velocities of its
// start, or those that its impacts are known to lead to, to the `count` contacts known, where none
// of these stands for them, up to `most`; returns how many there are then. `collide` finds contacts
// at a margin.
template <typename Collide>
int add_coming(const mjModel* m, mjData* d, int geom1, int geom2, mjtNum margin, int most,
               const Collide& collide, mjPreContact* contact, int count) {
  if (count == 0 || count >= most) return count;
  const int known = count;
  const mjtNum along_round = kAlongRound * round_radius(m, geom1, geom2);
  mjPreContact end[mjMAXCONPAIR];
  const mjtNum* const velocity = face_buffers ? face_buffers->body_velocity : nullptr;
  const MovedGeom moved1(m, d, geom1, m->opt.timestep, Spin::kOfShape, velocity);
  const MovedGeom moved2(m, d, geom2, m->opt.timestep, Spin::kOfShape, velocity);
  // No error of MuJoCo jumps past their destructors: this needs no more memory than the first time.
  const int end_count = collide(0.0, end);
  for (int i = 0; i < end_count && count < most; ++i) {
    if (mju_dot3(end[i].normal, contact[0].normal) < kAlike) continue;
    mjtNum surface1[3], surface2[3], apart[3];
    mju_addScl3(surface1, end[i].pos, end[i].normal, -0.5 * end[i].dist);
    mju_addScl3(surface2, end[i].pos, end[i].normal, 0.5 * end[i].dist);
    moved1.move_back(surface1);
    moved2.move_back(surface2);
    mju_sub3(apart, surface2, surface1);
    mjPreContact& c = contact[count];
    c.dist = mju_dot3(apart, end[i].normal);
    if (c.dist <= 0.0 || c.dist > margin) continue;
    mju_add3(c.pos, surface1, surface2);
    mju_scl3(c.pos, c.pos, 0.5);
    // Two contacts at one place would be twice as stiff and damped. Near: as far as geoms may move.
    const auto stands_for_it = [&](const mjPreContact& of_start) {
      const mjtNum way = mju_dist3(of_start.pos, c.pos);
      return way < along_round ||
             (way < margin && gap_at_end(of_start, moved1, moved2) < kAsDeep * end[i].dist);
    };
    if (std::any_of(contact, contact + known, stands_for_it)) continue;
    mju_copy3(c.normal, end[i].normal);
    mju_zero3(c.tangent);
    ++count;
  }
  return count;
}

// Whether a mesh touches a face of the other geom.
bool has_corner_on_face(const mjModel* m, const mjData* d, int geom1, int geom2,
                        const mjPreContact& contact) {
  if (!face_buffers) return false;
  const Eigen::Map<const Eigen::Vector3d> normal(contact.normal);
  return (m->geom_type[geom2] == mjGEOM_MESH &&
          has_face_along(m, d, geom1, normal, kOfFace, *face_buffers)) ||
         (m->geom_type[geom1] == mjGEOM_MESH &&
          has_face_along(m, d, geom2, -normal, kOfFace, *face_buffers));
}

// What `collide` finds where MuJoCo looks for the nearest points alone, within `tolerance` (m) of
// their distance if its iterations last.
template <typename Collide>
int in_one_point(double tolerance, const Collide& collide) {
  mjOption& option = replaced->opt;
  const int flags = option.disableflags;
  const mjtNum own = option.ccd_tolerance;
  option.disableflags |= mjDSBL_MULTICCD;
  option.ccd_tolerance = std::min<mjtNum>(own, tolerance);
  const int count = collide();
  option.disableflags = flags;
  option.ccd_tolerance = own;
  return count;
}

// Whether MuJoCo searches for the nearest points of two extended geoms.
bool are_nearest_points_searched(const mjModel* m, int geom1, int geom2) {
  const int type1 = m->geom_type[geom1], type2 = m->geom_type[geom2];
  if (type1 == mjGEOM_PLANE || (type1 == mjGEOM_BOX && type2 == mjGEOM_BOX)) return false;
  return type1 != mjGEOM_CAPSULE || (type2 != mjGEOM_CAPSULE && type2 != mjGEOM_BOX);
}

// Of a capsule the segment inside is apart from what it touches: that search is close enough.
double search_tolerance(const mjModel* m, int geom1) {
  return m->geom_type[geom1] == mjGEOM_CAPSULE ? mjMAXVAL : kSearchTolerance;
}

// All contacts of extended geoms, and of planes with meshes: at most mjMAXCONPAIR.
int find_contacts(const mjModel* m, mjData* d, int geom1, int geom2, mjtNum margin,
                  mjPreContact* contact) {
  const int type1 = m->geom_type[geom1], type2 = m->geom_type[geom2];
  int most = mj_maxContact(m, geom1, geom2, 1);
  const mjfCollision collide_pair = collide_now[type1][type2];
  const auto collide = [&](mjtNum within, mjPreContact* found) {
    const auto ask = [&] { return collide_pair(m, d, found, geom1, geom2, within); };
    if (!face_buffers || may_adhere(m, geom1, geom2)) return ask();
    const int count = are_nearest_points_searched(m, geom1, geom2)
                          ? in_one_point(search_tolerance(m, geom1), ask)
                          : ask();
    if (count == 0) return count;
    const int of_faces =
        take_points_of_faces(m, d, geom1, geom2, within, *face_buffers, found, count);
    if (of_faces > 0) {
      most = mjMAXCONPAIR;
      return of_faces;
    }
    if (!has_round_side(type1)) return count;
    most = std::max(most, 2);
    return take_ends_of_sides(m, d, geom1, geom2, within, *face_buffers, found, count);
  };
  int count = collide(margin, contact);
  if (type1 == mjGEOM_PLANE) return count;
  const mjtNum width = std::min(half_width(m, geom1), half_width(m, geom2));
  if (type1 == mjGEOM_BOX && type2 == mjGEOM_BOX && count == 0 && margin > kFarReach * width)
    count = mjc_Convex(m, d, contact, geom1, geom2, margin);
  if (margin <= kFastReachOfMesh * width) return count;
  if (margin <= kFastReach * width &&
      !(count == 1 && has_corner_on_face(m, d, geom1, geom2, contact[0])))
    return count;
  return add_coming(m, d, geom1, geom2, margin, most, collide, contact, count);
}

int collide_moving(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                   mjtNum margin) {
  if (m != replaced)
    return collide_now[m->geom_type[geom1]][m->geom_type[geom2]](m, d, contact, geom1, geom2,
                                                                 margin);
  mjPreContact found[mjMAXCONPAIR];
  const int count = find_contacts(m, d, geom1, geom2, margin, found);
  const int room = std::min(count, mj_maxContact(m, geom1, geom2, 1));
  std::copy_n(found, room, contact);
  for (int i = room; i < count; ++i) {  // points of faces or sides, so there are buffers
    SurplusContact& more = face_buffers->surplus.emplace_back();
    more.geom = {geom1, geom2};
    more.distance = found[i].dist;
    mju_copy3(more.position.data(), found[i].pos);
    mju_copy3(more.normal.data(), found[i].normal);
  }
  return room;
}

// Ellipsoids meet in one point.
int collide_ellipsoid(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                      mjtNum margin) {
  const auto collide = [&] {
    return collide_now[m->geom_type[geom1]][m->geom_type[geom2]](m, d, contact, geom1, geom2,
                                                                 margin);
  };
  return m == replaced && face_buffers ? in_one_point(kSearchTolerance, collide) : collide();
}

int collide_on_terrain(const mjModel* m, mjData* d, mjPreContact* contact, int terrain, int geom,
                       mjtNum margin) {
  const mjfCollision collide = collide_now[mjGEOM_HFIELD][m->geom_type[geom]];
  const int count = collide(m, d, contact, terrain, geom, margin);
  if (m != replaced || !face_buffers || may_adhere(m, terrain, geom)) return count;
  return take_points_on_terrain(m, d, terrain, geom, margin, *face_buffers, contact, count);
}

int collide_flat_cylinder(const mjModel* m, mjData* d, mjPreContact* contact, int plane,
                          int cylinder, mjtNum margin) {
  if (m != replaced) return collide_cylinder(m, d, contact, plane, cylinder, margin);
  const mjtNum* rotation = d->geom_xmat + 9 * cylinder;
  const mjtNum radius = m->geom_size[3 * cylinder], half_length = m->geom_size[3 * cylinder + 1];
  mjtNum normal[3], axis[3], tilt[3], centre[3];
  column_of(d->geom_xmat + 9 * plane, 2, normal);
  column_of(rotation, 2, axis);
  mju_cross(tilt, axis, normal);
  if (mju_norm3(tilt) >= kFlat) return collide_cylinder(m, d, contact, plane, cylinder, margin);
  mju_sub3(centre, d->geom_xpos + 3 * cylinder, d->geom_xpos + 3 * plane);
  // The cap that faces the plane.
  const mjtNum to_cap = mju_dot3(axis, normal) > 0 ? -half_length : half_length;
  int count = 0;
  for (int point = 0; point < 3; ++point) {
    mjtNum arm[3], position[3];
    const mjtNum cosine = point == 0 ? 1.0 : kThirdTurn[0];
    const mjtNum sine = point == 0 ? 0.0 : (point == 1 ? kThirdTurn[1] : -kThirdTurn[1]);
    for (int i = 0; i < 3; ++i)
      arm[i] = to_cap * axis[i] + radius * (cosine * rotation[3 * i] + sine * rotation[3 * i + 1]);
    mju_add3(position, centre, arm);
    const mjtNum distance = mju_dot3(position, normal);
    if (distance > margin) continue;
    mjPreContact& c = contact[count++];
    c.dist = distance;
    mju_add3(c.pos, d->geom_xpos + 3 * cylinder, arm);
    mju_addToScl3(c.pos, normal, -0.5 * distance);
    mju_copy3(c.normal, normal);
    mju_zero3(c.tangent);
  }
  return count;
}

// Once in a process.
void install() {
  static const bool installed = [] {
    for (int type1 : kExtended)
      for (int type2 : kExtended) {
        mjfCollision& pair = mjCOLLISIONFUNC[type1][type2];
        if (!pair) continue;
        collide_now[type1][type2] = pair;
        pair = collide_moving;
      }
    for (int type2 : {mjGEOM_ELLIPSOID, mjGEOM_CYLINDER, mjGEOM_BOX, mjGEOM_MESH}) {
      mjfCollision& pair = mjCOLLISIONFUNC[mjGEOM_ELLIPSOID][type2];
      collide_now[mjGEOM_ELLIPSOID][type2] = pair;
      pair = collide_ellipsoid;
    }
    for (int type = 0; type < mjNGEOMTYPES; ++type) {
      mjfCollision& on_terrain = mjCOLLISIONFUNC[mjGEOM_HFIELD][type];
      if (!on_terrain || !has_points_on_terrain(type)) continue;
      collide_now[mjGEOM_HFIELD][type] = on_terrain;
      on_terrain = collide_on_terrain;
    }
    mjfCollision& on_plane = mjCOLLISIONFUNC[mjGEOM_PLANE][mjGEOM_MESH];
    collide_now[mjGEOM_PLANE][mjGEOM_MESH] = on_plane;
    on_plane = collide_moving;
    mjfCollision& standing = mjCOLLISIONFUNC[mjGEOM_PLANE][mjGEOM_CYLINDER];
    collide_cylinder = standing;
    standing = collide_flat_cylinder;
    return true;
  }();
  static_cast<void>(installed);
}

}  // namespace

ReplacedCollisions::ReplacedCollisions(mjModel_* m, FaceBuffers* faces)
    : model_(m),
      flags_(m->opt.disableflags),
      tolerance_(m->opt.ccd_tolerance),
      outer_(replaced),
      outer_faces_(face_buffers) {
  install();
  replaced = m;
  face_buffers = faces;
}

ReplacedCollisions::~ReplacedCollisions() {
  model_->opt.disableflags = flags_;
  model_->opt.ccd_tolerance = tolerance_;
  replaced = outer_;
  face_buffers = outer_faces_;
}

double distance_of_convex(const mjModel_* m, mjData_* d, int geom1, int geom2, double most) {
  mjPreContact nearest[mjMAXCONPAIR];
  const int count =
      in_one_point(mjMAXVAL, [&] { return mjc_Convex(m, d, nearest, geom1, geom2, most); });
  return count > 0 ? std::min(most, nearest[0].dist) : most;
}

int collide_all(const mjModel_* m, mjData_* d, int geom1, int geom2, double margin,
                mjPreContact_* contact) {
  const mjfCollision collide = mjCOLLISIONFUNC[m->geom_type[geom1]][m->geom_type[geom2]];
  return collide == collide_moving ? find_contacts(m, d, geom1, geom2, margin, contact)
                                   : collide(m, d, contact, geom1, geom2, margin);
}

}  // namespace dashpot::host
