#include "dashpot/mujoco/mocap_bodies.hpp"

#include <mujoco/mujoco.h>

#include <array>

#include "dashpot/mujoco/equality_sides.hpp"

namespace dashpot::host {

namespace {

// The mocap body that a body is or is fixed to; -1 for none.
int mocap_of(const mjModel* m, int body) {
  return m->body_treeid[body] < 0 ? m->body_mocapid[m->body_rootid[body]] : -1;
}

}  // namespace

bool holds(const mjModel_* m, int equality, int mocap) {
  const std::array<int, 2> body = joined_bodies(m, equality);
  return mocap_of(m, body[0]) == mocap || mocap_of(m, body[1]) == mocap;
}

bool holds_anything(const mjModel_* m, const mjData_* d, int mocap) {
  for (int i = 0; i < m->neq; ++i)
    if (d->eq_active[i] && holds(m, i, mocap)) return true;
  return false;
}

std::array<double, 7> pose_where_met(const mjModel_* m, const mjData_* d, int mocap,
                                     const std::array<double, 7>& pose) {
  for (int i = 0; i < m->neq; ++i) {
    if (!d->eq_active[i] || !holds(m, i, mocap)) continue;
    const EqualitySide side[2] = {side_of(m, d, i, 0), side_of(m, d, i, 1)};
    const int own = mocap_of(m, side[0].body) == mocap ? 0 : 1;
    return where_met(side[own], side[1 - own], m->eq_type[i] == mjEQ_WELD, pose);
  }
  return pose;
}

std::vector<int> driven_bodies(const mjModel_* m) {
  std::vector<int> bodies(m->nmocap);
  for (int id = 1; id < m->nbody; ++id) {
    if (const int mocap = m->body_mocapid[id]; mocap >= 0)
      bodies[mocap] = id;
    else if (m->body_parentid[id] == 0 && is_fixed(m, id))
      bodies.push_back(id);
  }
  return bodies;
}

bool is_fixed(const mjModel_* m, int body) { return m->body_treeid[body] < 0; }

const double* mocap_twist(const mjModel_* m, const mjData_* d, int body) {
  const int root = m->body_rootid[body];
  return root > 0 && is_fixed(m, root) ? d->cvel + 6 * root : nullptr;
}

bool is_held_by_mocap(const mjModel_* m, int equality) {
  if (m->nmocap == 0) return false;
  const std::array<int, 2> body = joined_bodies(m, equality);
  return mocap_of(m, body[0]) >= 0 || mocap_of(m, body[1]) >= 0;
}

}  // namespace dashpot::host
