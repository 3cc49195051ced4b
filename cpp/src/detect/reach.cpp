// How far contacts and limits may be at the start of a step to start in it.

#include "dashpot/detect/reach.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/model/contacts.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

using Vector = Eigen::Map<const Eigen::Vector3d>;

// Velocity of the point of a body that is at `point`.
Eigen::Vector3d velocity_at(const mjModel* m, const mjData* d, int body, const Vector& point,
                            const double* body_velocity) {
  const Vector centre(d->subtree_com + 3 * m->body_rootid[body]);
  const Vector angular(body_velocity + 6 * body), linear(body_velocity + 6 * body + 3);
  return linear + angular.cross(point - centre);
}

// Largest speed of any point of a body within `radius` of `point`.
double speed_about(const mjModel* m, const mjData* d, int body, const mjtNum* point, double radius,
                   const double* body_velocity) {
  return velocity_at(m, d, body, Vector(point), body_velocity).norm() +
         Vector(body_velocity + 6 * body).norm() * radius;
}

// Largest speed of the vertices of a flex, or of the nodes that carry them.
double flex_speed(const mjModel* m, const mjData* d, int flex, const double* body_velocity) {
  const bool nodes = m->flex_interp[flex];
  const int begin = nodes ? m->flex_nodeadr[flex] : m->flex_vertadr[flex];
  const int count = nodes ? m->flex_nodenum[flex] : m->flex_vertnum[flex];
  double speed = 0.0;
  for (int i = begin; i < begin + count; ++i) {
    const int body = nodes ? m->flex_nodebodyid[i] : m->flex_vertbodyid[i];
    const double radius = mju_norm3(nodes ? m->flex_node + 3 * i : m->flex_vert + 3 * i);
    speed = std::max(speed, speed_about(m, d, body, d->xpos + 3 * body, radius, body_velocity));
  }
  return speed;
}

// Distance (m) from `point` that no moving geom that may collide reaches beyond.
double farthest_reach(const mjModel* m, const mjData* d, const mjtNum* point) {
  double farthest = 0.0;
  for (int geom = 0; geom < m->ngeom; ++geom)
    if (moves_and_collides(m, geom))
      farthest =
          std::max(farthest, mju_dist3(d->geom_xpos + 3 * geom, point) + m->geom_rbound[geom]);
  return farthest;
}

}  // namespace

double geom_speed(const mjModel* m, const mjData* d, int geom, const double* body_velocity) {
  const int body = m->geom_bodyid[geom];
  const mjtNum* centre = d->geom_xpos + 3 * geom;
  const bool turning_plane =
      m->geom_type[geom] == mjGEOM_PLANE && !mju_isZero(body_velocity + 6 * body, 3);
  const double radius = turning_plane ? farthest_reach(m, d, centre) : m->geom_rbound[geom];
  return speed_about(m, d, body, centre, radius, body_velocity);
}

double relative_speed(const mjModel* m, const mjData* d, int geom1, int geom2,
                      const double* body_velocity) {
  const int body1 = m->geom_bodyid[geom1], body2 = m->geom_bodyid[geom2];
  const double turning =
      (Vector(body_velocity + 6 * body2) - Vector(body_velocity + 6 * body1)).norm();
  double least = std::numeric_limits<double>::infinity();
  for (int geom : {geom1, geom2}) {
    // Neither planes nor height fields have a radius to count on.
    if (m->geom_type[geom] == mjGEOM_PLANE || m->geom_type[geom] == mjGEOM_HFIELD) continue;
    const Vector centre(d->geom_xpos + 3 * geom);
    const Eigen::Vector3d velocity = velocity_at(m, d, body2, centre, body_velocity) -
                                     velocity_at(m, d, body1, centre, body_velocity);
    least = std::min(least, velocity.norm() + turning * m->geom_rbound[geom]);
  }
  return least;
}

bool moves_and_collides(const mjModel* m, int geom) {
  const int body = m->geom_bodyid[geom];
  const bool moves = !is_fixed(m, body) || m->body_mocapid[m->body_rootid[body]] >= 0;
  return moves && may_collide(m, geom);
}

void ReachBuffers::start(const mjModel_* m, const double* last_displacement) {
  least_reach.assign(m->ngeom, 0.0);
  least_dof_reach.assign(m->nv, 0.0);
  if (!last_displacement) return;
  for (int i = 0; i < m->nv; ++i) least_dof_reach[i] = std::abs(last_displacement[i]);
}

double ReachBuffers::own_gap(const std::array<int, 2>& geom, int pair) const {
  return pair >= 0 ? pair_gap[pair] : geom_gap[geom[0]] + geom_gap[geom[1]];
}

WidenedReach::WidenedReach(mjModel_* m, const mjData_* d, const std::vector<double>* acceleration,
                           FaceBuffers* faces, Narrowing* narrowing, ReachBuffers& buffers)
    : collisions_(m, faces, narrowing), m_(m), buffers_(buffers) {
  buffers.geom_gap.assign(m->geom_gap, m->geom_gap + m->ngeom);
  buffers.body_margin.assign(m->body_margin, m->body_margin + m->nbody);
  buffers.pair_gap.assign(m->pair_gap, m->pair_gap + m->npair);
  buffers.flex_gap.assign(m->flex_gap, m->flex_gap + m->nflex);
  buffers.joint_margin.assign(m->jnt_margin, m->jnt_margin + m->njnt);
  buffers.tendon_margin.assign(m->tendon_margin, m->tendon_margin + m->ntendon);
  const double h = m->opt.timestep;
  std::vector<double>&now = buffers.now, &later = buffers.later;
  std::vector<double>&end_velocity = buffers.end_velocity, &reach = buffers.reach;
  end_velocity.resize(m->nv);
  body_velocities(m, d, d->qvel, now);
  if (acceleration) {
    for (int i = 0; i < m->nv; ++i) end_velocity[i] = d->qvel[i] + h * (*acceleration)[i];
    body_velocities(m, d, end_velocity.data(), later);
  }
  reach.assign(m->ngeom, 0.0);
  buffers.dof_reach.resize(m->nv);
  buffers.least_reach.resize(m->ngeom);
  buffers.least_dof_reach.resize(m->nv);
  buffers.start_reach.assign(m->ngeom, 0.0);
  // All that may throw is done: where a constructor does, no destructor puts the model right.
  for (int geom = 0; geom < m->ngeom; ++geom) {
    const bool is_edited = is_moving(now.data() + 6 * m->geom_bodyid[geom]) && may_collide(m, geom);
    if (!moves_and_collides(m, geom) && !is_edited) continue;
    buffers.start_reach[geom] = reach[geom] = h * geom_speed(m, d, geom, now.data());
    if (!acceleration) continue;
    reach[geom] = std::max({buffers.start_reach[geom], h * geom_speed(m, d, geom, later.data()),
                            buffers.least_reach[geom]});
    m->geom_gap[geom] = std::max(buffers.geom_gap[geom], reach[geom]);
    // The broadphase goes by the largest of a body's geoms.
    mjtNum& margin = m->body_margin[m->geom_bodyid[geom]];
    margin = std::max(margin, m->geom_margin[geom] + m->geom_gap[geom]);
  }
  if (!acceleration) return;
  for (int pair = 0; pair < m->npair; ++pair)
    m->pair_gap[pair] =
        std::max(buffers.pair_gap[pair], reach[m->pair_geom1[pair]] + reach[m->pair_geom2[pair]]);

  for (int flex = 0; flex < m->nflex; ++flex)
    m->flex_gap[flex] = std::max(
        buffers.flex_gap[flex],
        h * std::max(flex_speed(m, d, flex, now.data()), flex_speed(m, d, flex, later.data())));

  std::vector<double>& dof_reach = buffers.dof_reach;
  for (int i = 0; i < m->nv; ++i)
    dof_reach[i] = std::max(h * std::max(std::abs(d->qvel[i]), std::abs(end_velocity[i])),
                            buffers.least_dof_reach[i]);
  for (int joint = 0; joint < m->njnt; ++joint) {
    // A ball joint's angle changes no faster than its angular velocity.
    const int dofs = m->jnt_type[joint] == mjJNT_BALL ? 3 : 1;
    for (int i = 0; i < dofs; ++i) m->jnt_margin[joint] += dof_reach[m->jnt_dofadr[joint] + i];
  }
  for (int tendon = 0; tendon < m->ntendon; ++tendon)
    for (int k = m->ten_J_rowadr[tendon]; k < m->ten_J_rowadr[tendon] + m->ten_J_rownnz[tendon];
         ++k)
      m->tendon_margin[tendon] += std::abs(d->ten_J[k]) * dof_reach[m->ten_J_colind[k]];
}

WidenedReach::~WidenedReach() {
  std::copy(buffers_.geom_gap.begin(), buffers_.geom_gap.end(), m_->geom_gap);
  std::copy(buffers_.body_margin.begin(), buffers_.body_margin.end(), m_->body_margin);
  std::copy(buffers_.pair_gap.begin(), buffers_.pair_gap.end(), m_->pair_gap);
  std::copy(buffers_.flex_gap.begin(), buffers_.flex_gap.end(), m_->flex_gap);
  std::copy(buffers_.joint_margin.begin(), buffers_.joint_margin.end(), m_->jnt_margin);
  std::copy(buffers_.tendon_margin.begin(), buffers_.tendon_margin.end(), m_->tendon_margin);
}

bool WidenedReach::within_own(const mjContact_& contact) const {
  const GapArrays own{buffers_.geom_gap.data(), buffers_.pair_gap.data(), buffers_.flex_gap.data()};
  return contact.dist < contact.includemargin + gap_of(m_, contact, own);
}

}  // namespace dashpot::host
