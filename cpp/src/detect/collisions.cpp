#include "dashpot/detect/collisions.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cstring>
#include <utility>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/detect/narrowing.hpp"
#include "dashpot/model/contacts.hpp"
#include "ellipsoid_contacts.hpp"
#include "face_contacts.hpp"
#include "terrain.hpp"

// Exported by MuJoCo though not in its public headers: the collision of any two convex geoms.
extern "C" int mjc_Convex(const mjModel* m, mjData* d, mjPreContact* con, int g1, int g2,
                          mjtNum margin);

namespace dashpot::host {

namespace {

// Fraction of the least half-width: a wider reach needs contacts of boxes that meet at a corner.
constexpr double kFarReach = 0.005;
// Types whose pairs meet in more than one point.
constexpr int kExtended[] = {mjGEOM_CAPSULE, mjGEOM_CYLINDER, mjGEOM_BOX, mjGEOM_MESH};
// Of the distance that a search ends with, in m and as a fraction of the smaller half width; of
// capsules, whose segment inside is apart from what it touches, as such a fraction alone.
constexpr double kSearchTolerance = 1e-9, kSearchToleranceOfWidth = 1e-8;
constexpr double kSearchToleranceOfCapsule = 1e-4;
constexpr double kTwins =
    1e-9;  // fraction of the radius between two points that are one but for rounding

// Tilt (rad) of a cylinder flat on a plane. Above it MuJoCo's distances are good to 1e-9 radii.
constexpr double kFlatTilt = 1e-6;
// Sine of the angle between the axis of a capsule and the normal of a plane from which on the axis
// gives a tangent, square to the normal within rounding.
constexpr double kTangentOfAxis = 1e-6;

thread_local ReplacedCollisions::Of replaced;
mjfCollision collide_now[mjNGEOMTYPES][mjNGEOMTYPES] = {}, collide_cylinder = nullptr,
             collide_capsule = nullptr;
mjfCollision collide_whole[mjNGEOMTYPES][mjNGEOMTYPES] = {};  // replaced, but not narrowed

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

// What `collide` finds where MuJoCo looks for the nearest points alone, within `tolerance` (m) of
// their distance if its iterations last.
template <typename Collide>
int in_one_point(double tolerance, const Collide& collide) {
  mjOption& option = replaced.model->opt;
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

double search_tolerance(const mjModel* m, int geom1, int geom2) {
  const double width = std::min(half_width(m, geom1), half_width(m, geom2));
  return m->geom_type[geom1] == mjGEOM_CAPSULE
             ? kSearchToleranceOfCapsule * width
             : std::min(kSearchTolerance, kSearchToleranceOfWidth * width);
}

// A capsule across the edge of a box may touch in one point that MuJoCo returns twice: two springs
// of which memory would take the second for new in every step. Returns how many are left.
int without_twin(const mjModel* m, int capsule, const mjPreContact* contact, int count) {
  const bool twins =
      count == 2 && mju_dist3(contact[0].pos, contact[1].pos) <= kTwins * m->geom_rbound[capsule];
  return twins ? 1 : count;
}

// All contacts of extended geoms, and of planes with meshes: at most mjMAXCONPAIR.
int find_contacts(const mjModel* m, mjData* d, int geom1, int geom2, mjtNum margin,
                  mjPreContact* contact) {
  const int type1 = m->geom_type[geom1], type2 = m->geom_type[geom2];
  const mjfCollision collide_pair = collide_now[type1][type2];
  const auto ask = [&] { return collide_pair(m, d, contact, geom1, geom2, margin); };
  const bool boxes = type1 == mjGEOM_BOX && type2 == mjGEOM_BOX;
  int count = 0;
  if (!replaced.faces || may_adhere(m, geom1, geom2)) {
    count = ask();
  } else {
    count = are_nearest_points_searched(m, geom1, geom2)
                ? in_one_point(search_tolerance(m, geom1, geom2), ask)
                : ask();
    if (type1 == mjGEOM_CAPSULE) count = without_twin(m, geom1, contact, count);
    if (count > 0) {
      const int of_faces =
          take_points_of_faces(m, d, geom1, geom2, margin, *replaced.faces, contact, count);
      if (of_faces > 0) return of_faces;
      if (has_round_side(type1))
        return take_ends_of_sides(m, d, geom1, geom2, margin, *replaced.faces, contact, count);
    }
  }
  if (!boxes || count > 0) return count;
  const mjtNum width = std::min(half_width(m, geom1), half_width(m, geom2));
  return margin > kFarReach * width ? mjc_Convex(m, d, contact, geom1, geom2, margin) : 0;
}

int collide_moving(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                   mjtNum margin) {
  if (m != replaced.model)
    return collide_now[m->geom_type[geom1]][m->geom_type[geom2]](m, d, contact, geom1, geom2,
                                                                 margin);
  mjPreContact found[mjMAXCONPAIR];
  const int count = find_contacts(m, d, geom1, geom2, margin, found);
  const int room = std::min(count, mj_maxContact(m, geom1, geom2, 1));
  std::copy_n(found, room, contact);
  for (int i = room; i < count; ++i) {  // points of faces or sides, so there are buffers
    SurplusContact& more = replaced.faces->surplus.emplace_back();
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
  if (m != replaced.model || !replaced.faces) return collide();
  const int count = in_one_point(search_tolerance(m, geom1, geom2), collide);
  if (count > 0) improve_ellipsoid_contact(m, d, geom1, geom2, *contact);
  return count;
}

int collide_on_terrain(const mjModel* m, mjData* d, mjPreContact* contact, int terrain, int geom,
                       mjtNum margin) {
  const mjfCollision collide = collide_now[mjGEOM_HFIELD][m->geom_type[geom]];
  const int count = collide(m, d, contact, terrain, geom, margin);
  if (m != replaced.model || !replaced.faces || may_adhere(m, terrain, geom)) return count;
  return take_points_on_terrain(m, d, terrain, geom, margin, *replaced.faces, contact, count);
}

// MuJoCo takes the lowest direction of the rim from the difference of nearly equal vectors. Of a
// cylinder that stands flat, tilted by a, distances are off by about 1e-16 / a radii: 90 um of a
// disc of 10 cm at 1e-12 rad. And its points jump about the rim as a tilt of any size turns. There
// three points that are fixed to the cylinder stand for its rim.
int collide_flat_cylinder(const mjModel* m, mjData* d, mjPreContact* contact, int plane,
                          int cylinder, mjtNum margin) {
  const Pose ground = unchecked_geom_pose(d, plane), pose = unchecked_geom_pose(d, cylinder);
  const Eigen::Vector3d normal = ground.rotation.col(2);
  if (m != replaced.model || pose.rotation.col(2).cross(normal).norm() >= kFlatTilt)
    return collide_cylinder(m, d, contact, plane, cylinder, margin);
  const mjtNum* const size = m->geom_size + 3 * cylinder;
  const PlacedFace cap = place_cap(size[0], size[1], pose, -normal, normal);
  int count = 0;
  for (int i = 0; i < cap.count; i += 2) {
    const double distance = normal.dot(cap.corner[i] - ground.position);
    if (distance > margin) continue;
    mjPreContact& c = contact[count++];
    c.dist = distance;
    Eigen::Map<Eigen::Vector3d>(c.pos) = cap.corner[i] - 0.5 * distance * normal;
    Eigen::Map<Eigen::Vector3d>(c.normal) = normal;
    mju_zero3(c.tangent);
  }
  return count;
}

// Tangents go along the axis. Of a capsule that stands on the plane MuJoCo takes what rounding
// leaves of it, or, where that is nothing, the x axis, which may be the normal: then nothing but
// the normal force would hold.
int collide_capsule_on_plane(const mjModel* m, mjData* d, mjPreContact* contact, int plane,
                             int capsule, mjtNum margin) {
  const int count = collide_capsule(m, d, contact, plane, capsule, margin);
  if (m != replaced.model) return count;
  for (mjPreContact* c = contact; c != contact + count; ++c) {
    mjtNum across[3];
    mju_cross(across, c->normal, c->tangent);
    if (mju_norm3(across) < kTangentOfAxis) mju_zero3(c->tangent);
  }
  return count;
}

int collide_narrowed(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                     mjtNum margin) {
  std::atomic_thread_fence(std::memory_order_acquire);  // of what install() wrote
  const mjfCollision collide = collide_whole[m->geom_type[geom1]][m->geom_type[geom2]];
  if (m == replaced.model && replaced.narrowing) {
    CandidatePair pair{{geom1, geom2}, defining_pair(m, geom1, geom2)};
    pair.within = margin;
    margin = replaced.narrowing->within(m, d, pair, replaced.narrowing->pairs());
  }
  return collide(m, d, contact, geom1, geom2, margin);
}

// Once in a process. Threads that run MuJoCo alone meanwhile see either all of it or nothing:
// whoever finds collide_narrowed() finds what it calls.
void install() {
  static const bool installed = [] {
    mjfCollision table[mjNGEOMTYPES][mjNGEOMTYPES];
    std::memcpy(table, mjCOLLISIONFUNC, sizeof table);
    for (int type1 : kExtended)
      for (int type2 : kExtended) {
        mjfCollision& pair = table[type1][type2];
        if (!pair) continue;
        collide_now[type1][type2] = pair;
        pair = collide_moving;
      }
    for (int type2 : {mjGEOM_ELLIPSOID, mjGEOM_CYLINDER, mjGEOM_BOX, mjGEOM_MESH}) {
      mjfCollision& pair = table[mjGEOM_ELLIPSOID][type2];
      collide_now[mjGEOM_ELLIPSOID][type2] = pair;
      pair = collide_ellipsoid;
    }
    for (int type = 0; type < mjNGEOMTYPES; ++type) {
      mjfCollision& on_terrain = table[mjGEOM_HFIELD][type];
      if (!on_terrain || type == mjGEOM_SDF) continue;
      collide_now[mjGEOM_HFIELD][type] = on_terrain;
      on_terrain = collide_on_terrain;
    }
    mjfCollision& on_plane = table[mjGEOM_PLANE][mjGEOM_MESH];
    collide_now[mjGEOM_PLANE][mjGEOM_MESH] = on_plane;
    on_plane = collide_moving;
    mjfCollision& standing = table[mjGEOM_PLANE][mjGEOM_CYLINDER];
    collide_cylinder = standing;
    standing = collide_flat_cylinder;
    collide_capsule = std::exchange(table[mjGEOM_PLANE][mjGEOM_CAPSULE], collide_capsule_on_plane);
    for (int type1 = 0; type1 < mjNGEOMTYPES; ++type1)
      for (int type2 = 0; type2 < mjNGEOMTYPES; ++type2) {
        mjfCollision& pair = table[type1][type2];
        if (!pair) continue;
        collide_whole[type1][type2] = pair;
        pair = collide_narrowed;
      }
    std::atomic_thread_fence(std::memory_order_release);
    std::memcpy(mjCOLLISIONFUNC, table, sizeof table);
    return true;
  }();
  static_cast<void>(installed);
}

}  // namespace

ReplacedCollisions::ReplacedCollisions(mjModel_* m, FaceBuffers* faces, Narrowing* narrowing)
    : model_(m),
      flags_(m->opt.disableflags),
      tolerance_(m->opt.ccd_tolerance),
      outer_(std::exchange(replaced, {m, faces, narrowing})) {
  install();
}

ReplacedCollisions::~ReplacedCollisions() {
  model_->opt.disableflags = flags_;
  model_->opt.ccd_tolerance = tolerance_;
  replaced = outer_;
}

double distance_of_convex(const mjModel_* m, mjData_* d, int geom1, int geom2, double most) {
  mjPreContact nearest[mjMAXCONPAIR];
  const int count =
      in_one_point(mjMAXVAL, [&] { return mjc_Convex(m, d, nearest, geom1, geom2, most); });
  return count > 0 ? std::min(most, nearest[0].dist) : most;
}

int collide_all(const mjModel_* m, mjData_* d, int geom1, int geom2, double margin,
                mjPreContact_* contact) {
  const mjfCollision collide = collide_whole[m->geom_type[geom1]][m->geom_type[geom2]];
  return collide == collide_moving ? find_contacts(m, d, geom1, geom2, margin, contact)
                                   : collide(m, d, contact, geom1, geom2, margin);
}

}  // namespace dashpot::host
