#include "dashpot/detection/possible_rows.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/detection/pair_filters.hpp"

namespace dashpot::host {

namespace {

template <typename T>
bool any_positive(const T* values, mjtSize count) {
  return std::any_of(values, values + count, [](T value) { return value > 0; });
}

bool may_have_constraints(const mjModel* m) {
  const auto enabled = [&](int flag) { return !(m->opt.disableflags & flag); };
  return (enabled(mjDSBL_EQUALITY) && m->neq > 0) ||
         (enabled(mjDSBL_LIMIT) &&
          (any_positive(m->jnt_limited, m->njnt) || any_positive(m->tendon_limited, m->ntendon))) ||
         (enabled(mjDSBL_FRICTIONLOSS) && (any_positive(m->dof_frictionloss, m->nv) ||
                                           any_positive(m->tendon_frictionloss, m->ntendon)));
}

bool may_have_contacts(const mjModel* m) {
  if (m->opt.disableflags & mjDSBL_CONTACT) return false;
  if (m->npair > 0 || m->nflex > 0) return true;
  for (int geom1 = 0; geom1 < m->ngeom; ++geom1) {
    if (!m->geom_contype[geom1] && !m->geom_conaffinity[geom1]) continue;
    for (int geom2 = geom1 + 1; geom2 < m->ngeom; ++geom2)
      if (may_meet(m, geom1, geom2)) return true;
  }
  return false;
}

}  // namespace

bool may_have_rows(const mjModel_* m) {
  if (m->opt.disableflags & mjDSBL_CONSTRAINT) return false;
  return may_have_constraints(m) || may_have_contacts(m);
}

}  // namespace dashpot::host
