#include "dashpot/mujoco/names.hpp"

#include <mujoco/mujoco.h>

namespace dashpot::host {

std::string named(const mjModel_* m, int type, int id) {
  const char* name = mj_id2name(m, type, id);
  return name && *name ? "'" + std::string(name) + "'" : "#" + std::to_string(id);
}

std::string contact_side(const mjModel_* m, int geom) {
  return geom < 0 ? "flex " + named(m, mjOBJ_FLEX, -1 - geom)
                  : "geom " + named(m, mjOBJ_GEOM, geom);
}

std::string constraint_name(const mjModel_* m, const mjData_* d, int row) {
  const int id = d->efc_id[row];
  switch (d->efc_type[row]) {
    case mjCNSTR_EQUALITY:
      return "equality " + named(m, mjOBJ_EQUALITY, id);
    case mjCNSTR_FRICTION_DOF:
      return "dry friction of joint " + named(m, mjOBJ_JOINT, m->dof_jntid[id]);
    case mjCNSTR_FRICTION_TENDON:
      return "dry friction of tendon " + named(m, mjOBJ_TENDON, id);
    case mjCNSTR_LIMIT_JOINT:
      return "limit of joint " + named(m, mjOBJ_JOINT, id);
    default:
      return "limit of tendon " + named(m, mjOBJ_TENDON, id);
  }
}

}  // namespace dashpot::host
