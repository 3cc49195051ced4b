#include "dashpot/model/sleep.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/constraint_memory.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/velocities.hpp"
#include "equalities.hpp"

// Exported by MuJoCo though not in its public headers: what follows from mjData.tree_asleep.
extern "C" void mj_updateSleep(const mjModel* m, mjData* d);

namespace dashpot::host {

namespace {

// Of mjData.tree_asleep: the last step was too fast; as many steps were slow as sleep takes. What
// sleeps has the next tree of its island there.
constexpr int kAwake = -(1 + mjMINAWAKE), kReady = -1;

std::vector<int>& counts_of_thread() {
  thread_local std::vector<int> counts;
  return counts;
}

bool may_ever_sleep(const mjModel* m, int tree) {
  const int policy = m->tree_sleep_policy[tree];
  return policy != mjSLEEP_NEVER && policy != mjSLEEP_AUTO_NEVER;
}

bool all_zero(const mjtNum* values, int count) {
  return std::all_of(values, values + count, [](mjtNum value) { return value == 0.0; });
}

bool could_sleep(const mjModel* m, const mjData* d, int tree, const std::vector<double>& shift) {
  const int body = m->tree_bodyadr[tree], dof = m->tree_dofadr[tree];
  if (!may_ever_sleep(m, tree) ||
      !all_zero(d->xfrc_applied + 6 * body, 6 * m->tree_bodynum[tree]) ||
      !all_zero(d->qfrc_applied + dof, m->tree_dofnum[tree]))
    return false;
  for (int i = dof; i < dof + m->tree_dofnum[tree]; ++i)
    if (!(m->dof_length[i] * std::max(std::abs(d->qvel[i]), std::abs(shift[i])) <
          m->opt.sleep_tolerance))
      return false;
  return true;
}

// The trees that an equality may tie, two of each side, -1 for none. Those of flexes never sleep.
std::array<int, 4> trees_of_equality(const mjModel* m, int equality) {
  const int type = m->eq_type[equality];
  const std::array<int, 2> body = joined_bodies(m, equality);
  std::array<int, 4> trees{-1, -1, -1, -1};
  for (int side = 0; side < 2; ++side) {
    const int id = side == 0 ? m->eq_obj1id[equality] : m->eq_obj2id[equality];
    int* const of_side = trees.data() + 2 * side;
    if (id < 0) continue;
    if (type == mjEQ_TENDON)
      std::copy_n(m->tendon_treeid + 2 * id, std::min(2, m->tendon_treenum[id]), of_side);
    else
      *of_side = m->body_treeid[type == mjEQ_JOINT ? m->jnt_bodyid[id] : body[side]];
  }
  return trees;
}

// Whether the rows of an equality held something when they were last made.
bool held(const mjModel* m, int equality, const Memory& memory) {
  const int first = memory_of_equality(m, equality);
  for (int row = first; row < first + equality_rows(m, equality); ++row)
    if (memory.constraint(row).stiffness != 0.0) return true;
  return false;
}

}  // namespace

bool may_sleep(const mjModel_* m) { return m->opt.enableflags & mjENBL_SLEEP; }

bool any_sleeps(const mjModel_* m, const mjData_* d) {
  return may_sleep(m) &&
         std::any_of(d->tree_asleep, d->tree_asleep + m->ntree, [](int next) { return next >= 0; });
}

bool sleeps(const mjData_* d, int tree) { return tree >= 0 && d->tree_asleep[tree] >= 0; }

bool rest_asleep(const mjModel_* m, const mjData_* d, const std::array<int, 2>& geoms) {
  bool any = false;
  for (int geom : geoms) {
    const int body = m->geom_bodyid[geom], tree = m->body_treeid[body];
    const mjtNum* twist = tree < 0 ? mocap_twist(m, d, body) : nullptr;
    const bool moves = m->body_mocapid[m->body_rootid[body]] >= 0 || (twist && is_moving(twist));
    if (tree < 0 ? moves : !sleeps(d, tree)) return false;
    any = any || tree >= 0;
  }
  return any;
}

void wake(const mjModel_* m, mjData_* d, int tree) {
  while (d->tree_asleep[tree] >= 0) {
    const int next = d->tree_asleep[tree];
    d->tree_asleep[tree] = kAwake;
    tree = next;
  }
  mj_updateSleep(m, d);
}

void wake_switched(const mjModel_* m, mjData_* d, const Memory& memory) {
  const bool disabled = m->opt.disableflags & (mjDSBL_EQUALITY | mjDSBL_CONSTRAINT);
  for (int i = 0; i < m->neq; ++i) {
    const bool active = d->eq_active[i] && !disabled;
    for (int tree : trees_of_equality(m, i)) {
      if (!sleeps(d, tree) || active == held(m, i, memory)) continue;
      // What sleeps from the start on remembers nothing.
      if (!active || m->tree_sleep_policy[tree] != mjSLEEP_INIT) wake(m, d, tree);
    }
  }
}

std::vector<int> find_falling_asleep(const mjModel_* m, mjData_* d, const std::vector<int>& island,
                                     const std::vector<char>& driven,
                                     const std::vector<double>& shift) {
  const int count = static_cast<int>(island.size());
  thread_local std::vector<char> waits;  // by island: not all of it can. A step allocates nothing
  waits.assign(count, 0);
  for (int tree = 0; tree < count; ++tree) {
    int& steps = d->tree_asleep[tree];
    if (steps >= 0) continue;
    if (driven[tree] || !could_sleep(m, d, tree, shift))
      steps = kAwake;
    else if (steps < kReady)
      ++steps;
    if (steps != kReady && island[tree] >= 0) waits[island[tree]] = 1;
  }
  std::vector<int> falling;
  for (int tree = 0; tree < count; ++tree)
    if (d->tree_asleep[tree] == kReady && (island[tree] < 0 || !waits[island[tree]]))
      falling.push_back(tree);
  return falling;
}

void put_to_sleep(mjModel_* m, mjData_* d, const std::vector<int>& trees,
                  const std::vector<int>& island) {
  for (int tree : trees) mju_zero(d->qvel + m->tree_dofadr[tree], m->tree_dofnum[tree]);
  // What depends on positions and velocities is that of their sleep from now on.
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  mj_factorM(m, d);
  mj_fwdVelocity(m, d);
  struct Ring {
    int first = -1, last = -1;  // trees
  };
  std::vector<Ring> rings(island.size());
  for (int tree : trees) {
    mju_zero(d->qacc + m->tree_dofadr[tree], m->tree_dofnum[tree]);
    Ring alone, &ring = island[tree] < 0 ? alone : rings[island[tree]];
    if (ring.first < 0)
      ring.first = tree;
    else
      d->tree_asleep[ring.last] = tree;
    d->tree_asleep[tree] = ring.first;
    ring.last = tree;
  }
  mj_updateSleep(m, d);
}

void find_sleeping_rows(const mjModel_* m, const mjData_* d, MarkedRows& sleeping) {
  sleeping = MarkedRows();
  if (!any_sleeps(m, d)) return;
  std::vector<char> dof(m->nv);
  for (int i = 0; i < m->nv; ++i) dof[i] = sleeps(d, m->dof_treeid[i]);
  mark_rows(m, dof, {}, sleeping);
}

void find_sleeping_dofs(const mjModel_* m, const mjData_* d, std::vector<int>& dofs) {
  dofs.clear();
  if (!any_sleeps(m, d)) return;
  for (int dof = 0; dof < m->nv; ++dof)
    if (sleeps(d, m->dof_treeid[dof])) dofs.push_back(dof);
}

StaysAwake::StaysAwake(const mjModel_* m, mjData_* d) : data_(d), counts_(counts_of_thread()) {
  counts_.assign(d->tree_asleep, d->tree_asleep + (may_sleep(m) ? m->ntree : 0));
  for (size_t tree = 0; tree < counts_.size(); ++tree)
    if (counts_[tree] < 0) d->tree_asleep[tree] = kAwake;
}

StaysAwake::~StaysAwake() { std::copy(counts_.begin(), counts_.end(), data_->tree_asleep); }

SleepAtStart::SleepAtStart(const mjModel* m, mjData* d, std::vector<int>& asleep)
    : model_(m), data_(d), asleep_(asleep) {
  asleep.assign(d->tree_asleep, d->tree_asleep + (any_sleeps(m, d) ? m->ntree : 0));
}

SleepAtStart::~SleepAtStart() {
  if (finished_ || asleep_.empty()) return;
  std::copy(asleep_.begin(), asleep_.end(), data_->tree_asleep);
  mj_updateSleep(model_, data_);
}

}  // namespace dashpot::host
