// How fast the Jacobians of equalities turn.
//
// A row's rate is u = J xi, so du/dt = J dxi/dt + dJ/dt xi. For a connect the second term is the
// acceleration that its two anchors have relative to each other while xi is constant: centripetal,
// and of Coriolis along a chain.

#include "equalities.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/constraints.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/row_turns.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

struct Acceleration {
  mjtNum angular[3], linear[3];
};

// Of a point (world) fixed to a body, while the generalized velocities are constant.
Acceleration generalized_acceleration(const mjModel* m, const mjData* d, int body,
                                      const mjtNum* point) {
  mjtNum spatial[6] = {};
  for (int dof = last_dof(m, body); dof >= 0; dof = m->dof_parentid[dof])
    for (int i = 0; i < 6; ++i) spatial[i] += d->cdof_dot[6 * dof + i] * d->qvel[dof];
  // From the spatial acceleration about the tree's centre of mass to that of the point itself.
  const mjtNum* rate = d->cvel + 6 * body;
  mjtNum arm[3], velocity[3], turn[3];
  mju_sub3(arm, point, d->subtree_com + 3 * m->body_rootid[body]);
  mju_cross(velocity, rate, arm);
  mju_addTo3(velocity, rate + 3);
  Acceleration a;
  mju_copy3(a.angular, spatial);
  mju_cross(a.linear, spatial, arm);
  mju_addTo3(a.linear, spatial + 3);
  mju_cross(turn, rate, velocity);
  mju_addTo3(a.linear, turn);
  return a;
}

// The same at constant motion coordinates: those of a free body are its centre's and its turn's.
Acceleration acceleration(const mjModel* m, const mjData* d, int body, const mjtNum* point,
                          const Trees& trees) {
  const int tree = m->body_treeid[body];
  if (tree < 0 || !trees.tree[tree].free_body) return generalized_acceleration(m, d, body, point);
  Acceleration a{};
  const mjtNum* rate = d->cvel + 6 * body;
  mjtNum arm[3], velocity[3];
  mju_sub3(arm, point, centre_of_motion(m, d, body));
  mju_cross(velocity, rate, arm);
  mju_cross(a.linear, rate, velocity);
  return a;
}

double turning_of_bodies(const mjModel* m, const mjData* d, int equality, int row,
                         const Trees& trees) {
  const EqualitySide side[2] = {side_of(m, d, equality, 0), side_of(m, d, equality, 1)};
  Acceleration relative = acceleration(m, d, side[0].body, side[0].anchor, trees);
  const Acceleration second = acceleration(m, d, side[1].body, side[1].anchor, trees);
  mju_subFrom3(relative.linear, second.linear);
  mju_subFrom3(relative.angular, second.angular);
  if (row < 3) return relative.linear[row];
  // MuJoCo's rate of the rotation error of a weld, (conj(q1) w q0) / 2 times the scale of torques;
  // both sides turn alike, so the rates of q0 and q1 add nothing.
  mjtNum inverse[4], turned[4], rate[4];
  mju_negQuat(inverse, side[1].orientation);
  mju_mulQuatAxis(turned, inverse, relative.angular);
  mju_mulQuat(rate, turned, side[0].orientation);
  return 0.5 * m->eq_data[mjNEQDATA * equality + 10] * rate[row - 2];
}

// Of an edge's length: velocity across the edge turns it, acceleration of vertices along it adds.
double turning_of_edge(const mjModel* m, const mjData* d, int flex, int edge, const Trees& trees) {
  mjtNum along[3]{}, velocity[3]{}, bend[3]{};
  for (int side = 0; side < 2; ++side) {
    const int vertex = m->flex_vertadr[flex] + m->flex_edge[2 * edge + side];
    const int body = m->flex_vertbodyid[vertex];
    const mjtNum* point = d->flexvert_xpos + 3 * vertex;
    const mjtNum sign = side == 0 ? -1.0 : 1.0;
    mjtNum rate[3];
    point_velocity(m, d, body, point, rate);
    mju_addToScl3(along, point, sign);
    mju_addToScl3(velocity, rate, sign);
    mju_addToScl3(bend, acceleration(m, d, body, point, trees).linear, sign);
  }
  const mjtNum length = mju_normalize3(along);
  if (length < mjMINVAL) return 0.0;
  const mjtNum stretching = mju_dot3(along, velocity);
  return (mju_dot3(velocity, velocity) - stretching * stretching) / length + mju_dot3(along, bend);
}

// Of x0 - p(x1) with the polynomial p of joint and tendon equalities: -p''(x1) v1^2.
double turning_of_polynomial(const mjtNum* p, double x, double velocity) {
  return -(2.0 * p[2] + x * (6.0 * p[3] + x * 12.0 * p[4])) * velocity * velocity;
}

// Of the joint, or the length of the tendon, that a polynomial is of, beyond that of the model.
double displacement_of_second(const mjModel* m, const mjData* d, int equality) {
  const int second = m->eq_obj2id[equality];
  if (m->eq_type[equality] == mjEQ_TENDON) return d->ten_length[second] - m->tendon_length0[second];
  const int position = m->jnt_qposadr[second];
  return d->qpos[position] - m->qpos0[position];
}

}  // namespace

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

double slope_of_equality(const mjModel_* m, const mjData_* d, int equality) {
  const int type = m->eq_type[equality];
  if (m->eq_obj2id[equality] < 0 || (type != mjEQ_JOINT && type != mjEQ_TENDON)) return 0.0;
  const mjtNum* p = m->eq_data + mjNEQDATA * equality;
  const double x = displacement_of_second(m, d, equality);
  return p[1] + x * (2.0 * p[2] + x * (3.0 * p[3] + x * 4.0 * p[4]));
}

double turning_of_equality(const mjModel_* m, const mjData_* d, int equality, int row,
                           const Trees& trees, const RowTurns& turns) {
  const int second = m->eq_obj2id[equality];
  const mjtNum* data = m->eq_data + mjNEQDATA * equality;
  switch (m->eq_type[equality]) {
    case mjEQ_CONNECT:
    case mjEQ_WELD:
      return turning_of_bodies(m, d, equality, row, trees);
    case mjEQ_JOINT:
      if (second < 0) return 0.0;
      return turning_of_polynomial(data, displacement_of_second(m, d, equality),
                                   d->qvel[m->jnt_dofadr[second]]);
    case mjEQ_TENDON: {
      const double first = turns.tendon_turning(m->eq_obj1id[equality]);
      if (second < 0) return first;
      return first - slope_of_equality(m, d, equality) * turns.tendon_turning(second) +
             turning_of_polynomial(data, displacement_of_second(m, d, equality),
                                   d->ten_velocity[second]);
    }
    case mjEQ_FLEX: {
      // Edges whose ends do not move have no row.
      const int flex = m->eq_obj1id[equality];
      if (m->flex_interp[flex]) return 0.0;
      int edge = m->flex_edgeadr[flex];
      while (m->flexedge_rigid[edge] || row-- > 0) ++edge;
      return turning_of_edge(m, d, flex, edge, trees);
    }
    default:
      return 0.0;
  }
}

}  // namespace dashpot::host
