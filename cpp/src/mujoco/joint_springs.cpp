#include "dashpot/mujoco/joint_springs.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/mujoco/discrete.hpp"

namespace dashpot::host {

namespace {

double stiffness_of(const mjModel* m, int dof) {
  const int joint = m->dof_jntid[dof];
  const bool single = m->jnt_type[joint] == mjJNT_SLIDE || m->jnt_type[joint] == mjJNT_HINGE;
  if (!single || is_discrete(m) || (m->opt.disableflags & mjDSBL_SPRING)) return 0.0;
  const mjtNum* high_order = m->jnt_stiffnesspoly + mjNPOLY * joint;
  const bool linear =
      std::all_of(high_order, high_order + mjNPOLY, [](mjtNum value) { return value == 0.0; });
  return linear ? m->jnt_stiffness[joint] : 0.0;
}

}  // namespace

void find_joint_springs(const mjModel_* m, Trees& trees) {
  for (Tree& t : trees.tree) {
    t.sprung = false;
    for (int i = 0; i < t.dof_count && !t.free_body; ++i)
      trees.stiffness[t.begin + i] = stiffness_of(m, t.dof_begin + i);
  }
}

double joint_spring_force(const mjModel_* m, const mjData_* d, int dof) {
  if (is_discrete(m)) return d->qfrc_spring[dof];
  const double stiffness = stiffness_of(m, dof);
  if (stiffness == 0.0) return 0.0;
  const int place = m->jnt_qposadr[m->dof_jntid[dof]];
  return stiffness * (m->qpos_spring[place] - d->qpos[place]);
}

}  // namespace dashpot::host
