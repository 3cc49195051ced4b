#include "dashpot/model/properties.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <limits>

#include "dashpot/law/constants.hpp"
#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/mocap_bodies.hpp"

namespace dashpot::host {

namespace {

// Half-thicknesses of what is thin that stand for its radius; that of a box of 1 : 2 : 2.
constexpr double kThin = 3.0;

// Contacts that may be compressed at once, of a scene, and more of each geom that moves, is fixed,
// or only to be seen until a user gives it a contype, and of each vertex of a flex: what dense
// heaps have, half of the points of every pair, and as much again.
constexpr int kCapacityOfAll = 64, kCapacityStatic = 8, kCapacityUnseen = 2, kCapacityOfVertex = 16;
// Prisms of six sides packed like a honeycomb have four pairs of twelve points each.
constexpr int kMostOfGeom = 48;

int capacity_of(int type) {
  switch (type) {
    case mjGEOM_SPHERE:
    case mjGEOM_ELLIPSOID:
      return 12;
    case mjGEOM_CAPSULE:
      return 16;
    case mjGEOM_BOX:
    case mjGEOM_CYLINDER:
      return 24;
    default:
      return kMostOfGeom;
  }
}

bool is_in_pair(const mjModel* m, int geom) {
  return std::find(m->pair_geom1, m->pair_geom1 + m->npair, geom) != m->pair_geom1 + m->npair ||
         std::find(m->pair_geom2, m->pair_geom2 + m->npair, geom) != m->pair_geom2 + m->npair;
}

// Trees that tendons join have several roots.
double tree_mass(const mjModel* m, int tree) {
  double mass = 0.0;
  int left = m->tree_bodynum[tree];
  for (int body = m->tree_bodyadr[tree]; left > 0 && body < m->nbody; ++body) {
    if (m->body_treeid[body] != tree) continue;
    --left;
    if (m->body_treeid[m->body_parentid[body]] != tree) mass += m->body_subtreemass[body];
  }
  return mass;
}

}  // namespace

int geom_count(const mjModel_* m) { return static_cast<int>(m->ngeom); }
int dof_count(const mjModel_* m) { return static_cast<int>(m->nv); }
int position_count(const mjModel_* m) { return static_cast<int>(m->nq); }
int flex_count(const mjModel_* m) { return static_cast<int>(m->nflex); }
int driven_count(const mjModel_* m) { return static_cast<int>(driven_bodies(m).size()); }
bool has_equalities(const mjModel_* m) { return m->neq > 0; }

bool has_adhesion(const mjModel_* m) {
  const int* types = m->actuator_trntype;
  return m->flg_adhesion || std::count(types, types + m->nactuator, mjTRN_BODY) > 0;
}

double gravity(const mjModel_* m) {
  return m->opt.disableflags & mjDSBL_GRAVITY ? 0.0 : mju_norm3(m->opt.gravity);
}

double usual_gravity(const mjModel_* m) {
  const double own = gravity(m);
  return own > 0.0 ? own : kStandardGravity;
}

double metre(const mjModel_* m) { return std::max(1.0, gravity(m) / kStandardGravity); }

std::array<double, 3> geom_friction(const mjModel_* m, int geom) {
  const mjtNum* f = geom < 0 ? m->flex_friction + 3 * (-1 - geom) : m->geom_friction + 3 * geom;
  return {f[0], f[1], f[2]};
}

int geom_priority(const mjModel_* m, int geom) {
  return geom < 0 ? m->flex_priority[-1 - geom] : m->geom_priority[geom];
}

int moved_body(const mjModel_* m, int geom) {
  if (geom < 0 || geom_tree(m, geom) < 0) return -1;
  return m->body_weldid[m->geom_bodyid[geom]];
}

int geom_tree(const mjModel_* m, int geom) { return m->body_treeid[m->geom_bodyid[geom]]; }

double geom_inverse_mass(const mjModel_* m, int geom) {
  const int body = m->geom_bodyid[geom], tree = m->body_treeid[body];
  // MuJoCo has that of the root at its own centre of mass for all that is welded to it.
  if (tree >= 0 && has_welded_parts(m, tree))
    return 1.0 / m->body_subtreemass[m->body_rootid[body]];
  return m->body_invweight0[2 * body];
}

int last_dof(const mjModel_* m, int body) {
  const int carrier = m->body_weldid[body];
  return m->body_dofnum[carrier] == 0 ? -1 : m->body_dofadr[carrier] + m->body_dofnum[carrier] - 1;
}

bool is_rotational(const mjModel* m, int dof) {
  const int joint = m->dof_jntid[dof], type = m->jnt_type[joint];
  if (type == mjJNT_SLIDE) return false;
  return type != mjJNT_FREE || dof >= m->jnt_dofadr[joint] + 3;
}

double contact_radius(const mjModel_* m, const ContactInput& input) {
  double radius = std::numeric_limits<double>::infinity();
  for (int geom : input.geom)
    if (geom >= 0 && m->geom_rbound[geom] > 0.0) radius = std::min(radius, m->geom_rbound[geom]);
  return radius;
}

double bearing_radius(const mjModel_* m, const ContactInput& input) {
  double radius = contact_radius(m, input);
  for (int side = 0; side < 2; ++side) {
    const int geom = input.geom[side];
    if (geom < 0 || input.tree[side] < 0) continue;
    const mjtNum* half = m->geom_aabb + 6 * geom + 3;
    const double thinnest = std::min({half[0], half[1], half[2]});
    if (thinnest > 0.0) radius = std::min(radius, kThin * thinnest);
  }
  return radius;
}

double contact_mass(const mjModel_* m, const ContactInput& input) {
  double mass = std::numeric_limits<double>::infinity();
  if (input.is_of_flex()) return mass;
  for (int geom : input.geom) {
    const int tree = m->body_treeid[m->geom_bodyid[geom]];
    if (tree >= 0) mass = std::min(mass, tree_mass(m, tree));
  }
  return mass;
}

bool may_collide(const mjModel_* m, int geom) {
  return m->geom_contype[geom] || m->geom_conaffinity[geom] || m->npair > 0;
}

int contact_capacity(const mjModel_* m) {
  const bool on_terrain =
      std::find(m->geom_type, m->geom_type + m->ngeom, mjGEOM_HFIELD) != m->geom_type + m->ngeom;
  int count = kCapacityOfAll + kCapacityOfVertex * static_cast<int>(m->nflexvert);
  for (int geom = 0; geom < m->ngeom; ++geom) {
    const int body = m->geom_bodyid[geom];
    if (!m->geom_contype[geom] && !m->geom_conaffinity[geom] && !is_in_pair(m, geom))
      count += kCapacityUnseen;
    else if (is_fixed(m, body) && m->body_mocapid[m->body_rootid[body]] < 0)
      count += kCapacityStatic;
    else
      count += on_terrain ? kMostOfGeom : capacity_of(m->geom_type[geom]);
  }
  return count;
}

}  // namespace dashpot::host
