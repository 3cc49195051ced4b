#include "dashpot/model/constraint_memory.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/properties.hpp"
#include "equalities.hpp"

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

// Displacement (m, rad) beyond rounding and differences that derivatives are found by.
constexpr double kMoved = 2e-6;

// By body: it, a joint of it, or what it hangs on is marked.
std::vector<char> mark_bodies(const mjModel* m, const std::vector<char>& dof,
                              const std::vector<int>& bodies) {
  std::vector<char> body(m->nbody, 0);
  for (int id : bodies) body[id] = 1;
  for (int id = 1; id < m->nbody; ++id) {
    const auto first = dof.begin() + std::max(0, m->body_dofadr[id]);
    body[id] = body[id] || body[m->body_parentid[id]] ||
               std::any_of(first, first + m->body_dofnum[id], [](char own) { return own; });
  }
  return body;
}

// Whether all bodies of a flex that have a tree are marked.
bool marks_flex(const mjModel* m, const std::vector<char>& body, int flex) {
  const bool nodes = m->flex_interp[flex];
  const int* first = nodes ? m->flex_nodebodyid + m->flex_nodeadr[flex]
                           : m->flex_vertbodyid + m->flex_vertadr[flex];
  const int* end = first + (nodes ? m->flex_nodenum[flex] : m->flex_vertnum[flex]);
  const auto has_tree = [&](int id) { return id >= 0 && m->body_treeid[id] >= 0; };
  return std::any_of(first, end, has_tree) &&
         std::all_of(first, end, [&](int id) { return !has_tree(id) || body[id]; });
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

void mark_rows(const mjModel_* m, const std::vector<char>& dof, const std::vector<int>& bodies,
               MarkedRows& rows) {
  const std::vector<char> body = mark_bodies(m, dof, bodies);
  std::vector<char> tree(m->ntree, 0);
  for (int i = 0; i < m->nv; ++i) tree[m->dof_treeid[i]] |= dof[i];
  rows.geom.resize(m->ngeom);
  for (int geom = 0; geom < m->ngeom; ++geom) {
    const int id = m->geom_bodyid[geom];
    rows.geom[geom] = body[id]                 ? GeomMark::kMarked
                      : m->body_treeid[id] < 0 ? GeomMark::kOfNoTree
                                               : GeomMark::kOther;
  }
  rows.flex.resize(m->nflex);
  for (int flex = 0; flex < m->nflex; ++flex) rows.flex[flex] = marks_flex(m, body, flex);
  rows.constraint.assign(constraint_memory_count(m), 0);
  const auto mark = [&](int first, int count, bool marked) {
    std::fill_n(rows.constraint.begin() + first, count, marked);
  };
  const auto marks_tendon = [&](int id) {
    const int* of = m->tendon_treeid + 2 * id;
    return std::any_of(of, of + std::min(2, m->tendon_treenum[id]), [&](int i) { return tree[i]; });
  };
  for (int i = 0; i < m->neq; ++i) {
    bool marked = false;
    for (int side = 0; side < 2; ++side) {
      const int type = m->eq_type[i], id = side == 0 ? m->eq_obj1id[i] : m->eq_obj2id[i];
      if (type == mjEQ_CONNECT || type == mjEQ_WELD)
        marked |= body[joined_bodies(m, i)[side]];
      else if (type == mjEQ_JOINT)
        marked |= id >= 0 && dof[m->jnt_dofadr[id]];
      else if (type == mjEQ_TENDON)
        marked |= id >= 0 && marks_tendon(id);
      else
        marked |= side == 0 && rows.flex[id];
    }
    mark(memory_of_equality(m, i), equality_rows(m, i), marked);
  }
  for (int i = 0; i < m->nv; ++i) mark(memory_of_friction(m, i), 1, dof[i]);
  for (int i = 0; i < m->njnt; ++i)
    mark(memory_of_joint_limit(m, i), kLimitSides, dof[m->jnt_dofadr[i]]);
  for (int i = 0; i < m->ntendon; ++i) {
    mark(memory_of_tendon_friction(m, i), 1, marks_tendon(i));
    mark(memory_of_tendon_limit(m, i), kLimitSides, marks_tendon(i));
  }
}

bool find_moved_by_hand(const mjModel_* m, const mjData_* d, const double* remembered,
                        std::vector<char>& dof) {
  dof.assign(m->nv, 0);
  if (std::equal(remembered, remembered + m->nq, d->qpos)) return false;
  const double least = kMoved * metre(m);
  std::vector<double> way(m->nv);
  mj_differentiatePos(m, way.data(), 1.0, remembered, d->qpos);
  bool any = false;
  for (int i = 0; i < m->nv; ++i) {
    if (std::abs(way[i]) <= least) continue;
    const int body = m->dof_bodyid[i];  // a ball joint has moved as a whole
    std::fill_n(dof.begin() + m->body_dofadr[body], m->body_dofnum[body], 1);
    any = true;
  }
  return any;
}

}  // namespace dashpot::host
