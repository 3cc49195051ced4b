#include "dashpot/mujoco_properties.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <limits>

namespace dashpot::host {

int geom_count(const mjModel_* m) { return static_cast<int>(m->ngeom); }
int dof_count(const mjModel_* m) { return static_cast<int>(m->nv); }
int position_count(const mjModel_* m) { return static_cast<int>(m->nq); }
int flex_count(const mjModel_* m) { return static_cast<int>(m->nflex); }
int mocap_count(const mjModel_* m) { return static_cast<int>(m->nmocap); }
bool has_equalities(const mjModel_* m) { return m->neq > 0; }

bool has_adhesion(const mjModel_* m) {
  const int* types = m->actuator_trntype;
  return m->flg_adhesion || std::count(types, types + m->nactuator, mjTRN_BODY) > 0;
}

double gravity(const mjModel_* m) {
  return m->opt.disableflags & mjDSBL_GRAVITY ? 0.0 : mju_norm3(m->opt.gravity);
}

std::array<double, 3> geom_friction(const mjModel_* m, int geom) {
  const mjtNum* f = geom < 0 ? m->flex_friction + 3 * (-1 - geom) : m->geom_friction + 3 * geom;
  return {f[0], f[1], f[2]};
}

int geom_priority(const mjModel_* m, int geom) {
  return geom < 0 ? m->flex_priority[-1 - geom] : m->geom_priority[geom];
}

int geom_tree(const mjModel_* m, int geom) { return m->body_treeid[m->geom_bodyid[geom]]; }

double geom_inverse_mass(const mjModel_* m, int geom) {
  return m->body_invweight0[2 * m->geom_bodyid[geom]];
}

int last_dof(const mjModel_* m, int body) {
  const int carrier = m->body_weldid[body];
  return m->body_dofnum[carrier] == 0 ? -1 : m->body_dofadr[carrier] + m->body_dofnum[carrier] - 1;
}

double contact_radius(const mjModel_* m, const ContactInput& input) {
  double radius = std::numeric_limits<double>::infinity();
  for (int geom : input.geom)
    if (geom >= 0 && m->geom_rbound[geom] > 0.0) radius = std::min(radius, m->geom_rbound[geom]);
  return radius;
}

double contact_mass(const mjModel_* m, const ContactInput& input) {
  double mass = std::numeric_limits<double>::infinity();
  if (input.is_of_flex()) return mass;
  for (int geom : input.geom) {
    const int tree = m->body_treeid[m->geom_bodyid[geom]];
    if (tree >= 0) mass = std::min(mass, m->body_subtreemass[m->tree_bodyadr[tree]]);
  }
  return mass;
}

int contact_site_count(const mjModel_* m) { return static_cast<int>(m->ngeom + m->nflexvert); }

bool may_collide(const mjModel_* m, int geom) {
  return m->geom_contype[geom] || m->geom_conaffinity[geom] || m->npair > 0;
}

int colliding_mesh_count(const mjModel_* m) {
  int count = 0;
  for (int geom = 0; geom < m->ngeom; ++geom)
    count += m->geom_type[geom] == mjGEOM_MESH && may_collide(m, geom);
  return count;
}

}  // namespace dashpot::host
