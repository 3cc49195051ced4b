#include "dashpot/mujoco/equality_sides.hpp"

#include <mujoco/mujoco.h>

namespace dashpot::host {

std::array<int, 2> joined_bodies(const mjModel_* m, int equality) {
  const int type = m->eq_type[equality];
  if (type != mjEQ_CONNECT && type != mjEQ_WELD) return {0, 0};
  const int first = m->eq_obj1id[equality], second = m->eq_obj2id[equality];
  if (m->eq_objtype[equality] == mjOBJ_SITE) return {m->site_bodyid[first], m->site_bodyid[second]};
  return {first, second};
}

EqualitySide side_of(const mjModel_* m, const mjData_* d, int equality, int index) {
  const int id = index == 0 ? m->eq_obj1id[equality] : m->eq_obj2id[equality];
  const mjtNum* data = m->eq_data + mjNEQDATA * equality;
  const bool weld = m->eq_type[equality] == mjEQ_WELD;
  EqualitySide side;
  if (m->eq_objtype[equality] == mjOBJ_SITE) {
    side.body = m->site_bodyid[id];
    mju_copy3(side.anchor, d->site_xpos + 3 * id);
    mju_mulQuat(side.orientation, d->xquat + 4 * side.body, m->site_quat + 4 * id);
    return side;
  }
  side.body = id;
  // A weld keeps the anchor of its second body first.
  mju_mulMatVec3(side.anchor, d->xmat + 9 * id, data + 3 * (weld ? 1 - index : index));
  mju_addTo3(side.anchor, d->xpos + 3 * id);
  mju_copy4(side.orientation, d->xquat + 4 * id);
  if (weld && index == 0) {
    const mjtNum* relative = data + 6;
    mju_mulQuat(side.orientation, d->xquat + 4 * id, relative);
  }
  return side;
}

std::array<double, 7> where_met(const EqualitySide& moved, const EqualitySide& other, bool weld,
                                const std::array<double, 7>& frame) {
  mjtNum inverse[4], turn[4] = {1.0, 0.0, 0.0, 0.0}, arm[3];
  std::array<double, 7> met;
  if (weld) {
    mju_negQuat(inverse, moved.orientation);
    mju_mulQuat(turn, other.orientation, inverse);
    mju_normalize4(turn);
  }
  mju_sub3(arm, frame.data(), moved.anchor);
  mju_rotVecQuat(met.data(), arm, turn);
  mju_addTo3(met.data(), other.anchor);
  mju_mulQuat(met.data() + 3, turn, frame.data() + 3);
  return met;
}

}  // namespace dashpot::host
