#include "dashpot/model/trees.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <vector>

#include "discrete.hpp"

namespace dashpot::host {

namespace {

constexpr double kOrthogonal = 1e-9;  // cosine of the axes of slides
constexpr int kFreeDofs = 6;
// Degrees of freedom of trees joined to one up to which inv(H) takes less time than what is sparse.
constexpr int kMostDense = 24;

using TreeSet = std::set<int>;

void insert_tree_of_body(const mjModel* m, int body, TreeSet& trees) {
  if (m->body_treeid[body] >= 0) trees.insert(m->body_treeid[body]);
}

void insert_trees_of_tendon(const mjModel* m, int tendon, TreeSet& trees) {
  const int begin = m->ten_J_rowadr[tendon];
  for (int k = begin; k < begin + m->ten_J_rownnz[tendon]; ++k)
    trees.insert(m->dof_treeid[m->ten_J_colind[k]]);
}

TreeSet trees_of_flex(const mjModel* m, int flex) {
  TreeSet trees;
  if (m->flex_interp[flex])
    for (int i = 0; i < m->flex_nodenum[flex]; ++i)
      insert_tree_of_body(m, m->flex_nodebodyid[m->flex_nodeadr[flex] + i], trees);
  else
    for (int i = 0; i < m->flex_vertnum[flex]; ++i)
      insert_tree_of_body(m, m->flex_vertbodyid[m->flex_vertadr[flex] + i], trees);
  return trees;
}

bool acts_along(const mjModel* m, int tendon) {
  const auto any = [&](const mjtNum* high_order) {
    return !mju_isZero(high_order + mjNPOLY * tendon, mjNPOLY);
  };
  return m->tendon_stiffness[tendon] != 0.0 || m->tendon_damping[tendon] != 0.0 ||
         any(m->tendon_stiffnesspoly) || any(m->tendon_dampingpoly);
}

// The trees of everything of which the metric of `discrete` may have entries between branches.
std::vector<TreeSet> trees_of_metric(const mjModel* m) {
  std::vector<TreeSet> coupled;
  if (!is_discrete(m)) return coupled;
  const auto add_tendon = [&](int tendon) {
    insert_trees_of_tendon(m, tendon, coupled.emplace_back());
  };
  for (int i = 0; i < m->ntendon; ++i)
    if (acts_along(m, i)) add_tendon(i);
  for (int i = 0; i < m->nactuator; ++i) {
    const int type = m->actuator_trntype[i], *id = m->actuator_trnid + 2 * i;
    if (type == mjTRN_TENDON) add_tendon(id[0]);
    if (type != mjTRN_SITE && type != mjTRN_SLIDERCRANK) continue;
    TreeSet& trees = coupled.emplace_back();
    for (int side = 0; side < 2; ++side)
      if (id[side] >= 0) insert_tree_of_body(m, m->site_bodyid[id[side]], trees);
  }
  for (int flex = 0; flex < m->nflex; ++flex)
    if (m->flex_dim[flex] > 1) coupled.push_back(trees_of_flex(m, flex));
  return coupled;
}

// The trees of every row, or family of rows, that may reach more than two.
std::vector<TreeSet> coupled_trees(const mjModel* m) {
  std::vector<TreeSet> coupled;
  const auto add = [&](TreeSet trees, size_t allowed) {
    if (trees.size() > allowed) coupled.push_back(std::move(trees));
  };
  for (int i = 0; i < m->ntendon; ++i) {
    if (!m->tendon_limited[i] && m->tendon_frictionloss[i] == 0.0) continue;
    TreeSet trees;
    insert_trees_of_tendon(m, i, trees);
    add(trees, 2);
  }
  for (int i = 0; i < m->neq; ++i) {
    if (m->eq_type[i] != mjEQ_TENDON) continue;
    TreeSet trees;
    insert_trees_of_tendon(m, m->eq_obj1id[i], trees);
    if (m->eq_obj2id[i] >= 0) insert_trees_of_tendon(m, m->eq_obj2id[i], trees);
    add(trees, 2);
  }
  // A contact on an element of a flex reaches several vertices and the body on the other side.
  for (int flex = 0; flex < m->nflex; ++flex) add(trees_of_flex(m, flex), 1);
  for (TreeSet& trees : trees_of_metric(m)) add(std::move(trees), 1);
  return coupled;
}

// For every tree the first and last of the trees that it is one with. Trees in between are taken
// along, so that the degrees of freedom stay one range.
struct Range {
  int first, last;
};
std::vector<Range> joined_ranges(const mjModel* m) {
  std::vector<Range> range(m->ntree);
  for (int i = 0; i < m->ntree; ++i) range[i] = {i, i};
  for (const TreeSet& trees : coupled_trees(m)) {
    const int first = range[*trees.begin()].first, last = range[*trees.rbegin()].last;
    for (int i = first; i <= last; ++i) range[i] = {first, last};
  }
  return range;
}

// The axes of the slides of a body, in the world, as far as they are at right angles to each other,
// and, unless null, their degrees of freedom; returns how many.
int slides_of(const mjModel* m, const mjData* d, int body, double* axis, int* dof) {
  int count = 0;
  for (int i = m->body_jntadr[body]; i < m->body_jntadr[body] + m->body_jntnum[body]; ++i) {
    if (m->jnt_type[i] != mjJNT_SLIDE || count == 3) continue;
    bool orthogonal = true;
    for (int k = 0; k < count; ++k)
      orthogonal = orthogonal && std::abs(mju_dot3(axis + 3 * k, d->xaxis + 3 * i)) <= kOrthogonal;
    if (!orthogonal) continue;
    mju_copy3(axis + 3 * count, d->xaxis + 3 * i);
    if (dof) dof[count] = static_cast<int>(m->jnt_dofadr[i]);
    ++count;
  }
  return count;
}

// Whether a tree of the model is several that were joined.
bool is_joined(const mjModel_* m, int tree) {
  const int *first = m->dof_parentid + m->tree_dofadr[tree], *last = first + m->tree_dofnum[tree];
  return std::count(first, last, -1) > 1;
}

}  // namespace

int tree_count(const mjModel_* m) {
  int count = static_cast<int>(m->ntree);
  while (count > 0 && m->tree_dofnum[count - 1] == 0) --count;
  return count;
}

bool is_free_body(const mjModel_* m, int tree) {
  const int joint = m->dof_jntid[m->tree_dofadr[tree]];
  return m->jnt_type[joint] == mjJNT_FREE && m->tree_dofnum[tree] == kFreeDofs;
}

int translations(const mjModel_* m, const mjData_* d, int tree, double* direction) {
  const int joint = m->dof_jntid[m->tree_dofadr[tree]], body = m->jnt_bodyid[joint];
  if (m->jnt_type[joint] == mjJNT_FREE) {
    std::fill_n(direction, 9, 0.0);
    for (int i = 0; i < 3; ++i) direction[4 * i] = 1.0;
    return 3;
  }
  return slides_of(m, d, body, direction, nullptr);
}

bool add_translation(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                     const double* direction, double* motion) {
  const Tree& t = trees.tree[tree];
  if (t.free_body) {
    mju_addTo3(motion + t.begin, direction);
    return true;
  }
  for (int dof = t.dof_begin; dof < t.dof_begin + t.dof_count; ++dof) {
    if (m->dof_parentid[dof] >= 0) continue;
    const int joint = m->dof_jntid[dof];
    double* const root = motion + t.begin - t.dof_begin;
    if (m->jnt_type[joint] == mjJNT_FREE) {
      mju_addTo3(root + dof, direction);
      continue;
    }
    double slide[9], rest[3];
    int slide_dof[3];
    const int count = slides_of(m, d, m->dof_bodyid[dof], slide, slide_dof);
    mju_copy3(rest, direction);
    for (int i = 0; i < count; ++i) {
      const double along = mju_dot3(slide + 3 * i, direction);
      root[slide_dof[i]] += along;
      mju_addToScl3(rest, slide + 3 * i, -along);
    }
    if (mju_norm3(rest) > kOrthogonal) return false;
  }
  return true;
}

Trees make_trees(const mjModel_* m) {
  Trees trees;
  TreeSet dense;
  for (const TreeSet& coupled : trees_of_metric(m)) dense.insert(coupled.begin(), coupled.end());
  std::vector<int> above(m->dof_parentid, m->dof_parentid + m->nv);
  for (int i = 0; i < tree_count(m); ++i) {
    const int begin = m->tree_dofadr[i], count = m->tree_dofnum[i];
    const bool sparse = count > kMostDense && is_joined(m, i);
    // Each above the next: H may couple any two.
    if (dense.count(i) > 0 && !sparse)
      std::iota(above.begin() + begin + 1, above.begin() + begin + count, begin);
    trees.append(begin, count, is_free_body(m, i), above.data() + begin, sparse);
  }
  return trees;
}

void join_coupled_trees(mjModel_* m) {
  const std::vector<Range> range = joined_ranges(m);
  std::vector<int> joined(m->ntree);
  int count = 0;
  for (int i = 0; i < m->ntree; ++i) {
    if (i > 0 && range[i].first != i) {
      const int tree = joined[i] = joined[i - 1];
      m->tree_sleep_policy[tree] = mjSLEEP_NEVER;
      m->tree_bodynum[tree] += m->tree_bodynum[i];
      m->tree_dofnum[tree] += m->tree_dofnum[i];
      continue;
    }
    const int tree = joined[i] = count++;
    m->tree_bodyadr[tree] = m->tree_bodyadr[i];
    m->tree_bodynum[tree] = m->tree_bodynum[i];
    m->tree_dofadr[tree] = m->tree_dofadr[i];
    m->tree_dofnum[tree] = m->tree_dofnum[i];
    m->tree_sleep_policy[tree] = m->tree_sleep_policy[i];
  }
  if (count == m->ntree) return;
  // Their number fixes the size of the model's buffer, so that trees joined to others stay, empty.
  for (int i = count; i < m->ntree; ++i) {
    m->tree_bodyadr[i] = m->tree_bodyadr[count - 1];
    m->tree_dofadr[i] = m->tree_dofadr[count - 1];
    m->tree_bodynum[i] = m->tree_dofnum[i] = 0;
  }
  for (int i = 0; i < m->nbody; ++i)
    if (m->body_treeid[i] >= 0) m->body_treeid[i] = joined[m->body_treeid[i]];
  for (int i = 0; i < m->nv; ++i) m->dof_treeid[i] = joined[m->dof_treeid[i]];
  for (int i = 0; i < m->ntendon; ++i) {
    TreeSet trees;
    insert_trees_of_tendon(m, i, trees);
    m->tendon_treenum[i] = static_cast<int>(trees.size());
    int side = 0;
    for (int tree : trees)
      if (side < 2) m->tendon_treeid[2 * i + side++] = tree;
  }
}

}  // namespace dashpot::host
