#include "dashpot/detect/joint_gaps.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Fraction of the smaller geom's radius by which faces that a joint slides on each other overlap.
constexpr double kFlush = 1e-8;

// The degree of freedom that alone moves two geoms against each other, or -1.
int dof_between(const mjModel* m, int geom1, int geom2) {
  const int body1 = m->geom_bodyid[geom1], body2 = m->geom_bodyid[geom2];
  const int root1 = m->body_rootid[body1], root2 = m->body_rootid[body2];
  if (root1 != root2 && (m->body_mocapid[root1] >= 0 || m->body_mocapid[root2] >= 0)) return -1;
  const int dof1 = last_dof(m, body1), dof2 = last_dof(m, body2);
  if (dof1 >= 0 && m->dof_parentid[dof1] == dof2) return dof1;
  return dof2 >= 0 && m->dof_parentid[dof2] == dof1 ? dof2 : -1;
}

// The widest gap (m) between planes across directions that the joint keeps, negative for none.
double gap_kept(const mjModel* m, const mjData* d, int geom1, int geom2) {
  constexpr double kNone = -std::numeric_limits<double>::infinity();
  const int dof = dof_between(m, geom1, geom2);
  if (dof < 0 || !has_shape(m, geom1) || !has_shape(m, geom2)) return kNone;
  const Shape shape1 = geom_shape(m, geom1), shape2 = geom_shape(m, geom2);
  if (!has_core(shape1) || !has_core(shape2)) return kNone;
  const Pose pose1 = unchecked_geom_pose(d, geom1), pose2 = unchecked_geom_pose(d, geom2);
  const Vector3d axis = Eigen::Map<const Vector3d>(d->xaxis + 3 * m->dof_jntid[dof]);
  double gap = kNone;
  const auto try_direction = [&](const Vector3d& direction) {
    for (double sign : {-1.0, 1.0})
      gap = std::max(gap, gap_along(shape1, pose1, shape2, pose2, sign * direction));
  };
  if (m->jnt_type[m->dof_jntid[dof]] == mjJNT_HINGE) {
    try_direction(axis);
    return gap;
  }
  for (const Pose& pose : {pose1, pose2})
    for (int i = 0; i < 3; ++i)
      if (const Vector3d direction = pose.rotation.col(i);
          std::abs(direction.dot(axis)) < kDirection)
        try_direction((direction - direction.dot(axis) * axis).normalized());
  return gap;
}

}  // namespace

bool keeps_its_gap(const mjModel_* m, const mjData_* d, const mjContact_& contact) {
  if (contact.dist < contact.includemargin || contact.geom[0] < 0 || contact.geom[1] < 0)
    return false;
  const int dof = dof_between(m, contact.geom[0], contact.geom[1]);
  if (dof < 0) return false;
  const mjtNum *axis = d->cdof + 6 * dof, *normal = contact.frame,
               *centre = d->subtree_com + 3 * m->body_rootid[m->dof_bodyid[dof]];
  mjtNum arm[3], velocity[3], off_axis[3];
  mju_cross(off_axis, normal, axis);
  if (mju_norm3(off_axis) > kDirection * mju_norm3(axis)) return false;
  mju_sub3(arm, contact.pos, centre);
  mju_cross(velocity, axis, arm);
  mju_addTo3(velocity, axis + 3);
  return std::abs(mju_dot3(normal, velocity)) < kDirection * mju_norm3(velocity);
}

bool JointGaps::keep_apart(const mjModel_* m, const mjData_* d, int geom1, int geom2,
                           double distance) {
  const std::array<int, 2> geom = {geom1, geom2};
  auto at =
      std::find_if(known_.begin(), known_.end(), [&](const Known& k) { return k.geom == geom; });
  if (at == known_.end()) {
    if (dof_between(m, geom1, geom2) < 0) return false;
    at = known_.insert(known_.end(), {geom, gap_kept(m, d, geom1, geom2)});
  }
  return at->gap >= distance - kFlush * std::min(m->geom_rbound[geom1], m->geom_rbound[geom2]);
}

}  // namespace dashpot::host
