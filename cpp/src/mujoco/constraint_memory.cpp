#include "dashpot/mujoco/constraint_memory.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

namespace dashpot::host {

namespace {

constexpr int kBodyRows = 6;     // most rows of an equality of bodies, joints or tendons (weld)
constexpr int kStrainRows = 18;  // of one cell of a flex

bool is_of_flex(const mjModel* m, int equality) {
  const int type = m->eq_type[equality];
  return type == mjEQ_FLEX || type == mjEQ_FLEXVERT || type == mjEQ_FLEXSTRAIN;
}

// Those of flexes begin behind all else.
int memory_of_flexes(const mjModel* m) {
  return memory_of_tendon_limit(m, static_cast<int>(m->ntendon));
}

// Memory of the rows of flex equalities before this one.
int flex_memory_before(const mjModel* m, int equality) {
  int count = 0;
  for (int i = 0; i < equality; ++i)
    if (is_of_flex(m, i)) count += equality_rows(m, i);
  return count;
}

}  // namespace

int memory_of_equality(const mjModel_* m, int equality) {
  return is_of_flex(m, equality) ? memory_of_flexes(m) + flex_memory_before(m, equality)
                                 : kBodyRows * equality;
}

// Of a flex one an edge, two a vertex, 18 a cell.
int equality_rows(const mjModel_* m, int equality) {
  if (!is_of_flex(m, equality)) return kBodyRows;
  const int flex = m->eq_obj1id[equality];
  const int* cells = m->flex_cellnum + 3 * flex;
  return std::max({m->flex_edgenum[flex], 2 * m->flex_vertnum[flex],
                   kStrainRows * cells[0] * cells[1] * cells[2]});
}

int memory_of_friction(const mjModel_* m, int dof) {
  return kBodyRows * static_cast<int>(m->neq) + dof;
}

int memory_of_tendon_friction(const mjModel_* m, int tendon) {
  return memory_of_friction(m, static_cast<int>(m->nv)) + tendon;
}

int memory_of_joint_limit(const mjModel_* m, int joint) {
  return memory_of_tendon_friction(m, static_cast<int>(m->ntendon)) + kLimitSides * joint;
}

int memory_of_tendon_limit(const mjModel_* m, int tendon) {
  return memory_of_joint_limit(m, static_cast<int>(m->njnt)) + kLimitSides * tendon;
}

int constraint_memory_count(const mjModel_* m) {
  return memory_of_flexes(m) + flex_memory_before(m, static_cast<int>(m->neq));
}

}  // namespace dashpot::host
