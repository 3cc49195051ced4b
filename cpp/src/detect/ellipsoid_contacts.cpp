#include "ellipsoid_contacts.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <cmath>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/ellipsoids.hpp"
#include "geom_on_terrain.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Cosine of the angle to the normal found beyond which ellipsoids have met elsewhere.
constexpr double kMetElsewhere = 0.9;
// Cosine between the normals of a face and of a contact that a search found on it.
constexpr double kFoundOnFace = 0.99999;

Vector3d size_of(const mjModel* m, int geom) { return Vector3d(m->geom_size + 3 * geom); }

// `normal` from the ellipsoid to the other geom.
void write(const Vector3d& normal, const Vector3d& point, double distance, mjPreContact& contact) {
  contact.dist = distance;
  Eigen::Map<Vector3d>(contact.normal) = normal;
  Eigen::Map<Vector3d>(contact.pos) = point + 0.5 * distance * normal;
}

void meet_ellipsoid(const mjModel* m, const mjData* d, int geom1, int geom2,
                    mjPreContact& contact) {
  const EllipsoidPair pair{size_of(m, geom1), size_of(m, geom2), unchecked_geom_pose(d, geom1),
                           unchecked_geom_pose(d, geom2)};
  const Vector3d found(contact.normal);
  EllipsoidContact nearest;
  if (find_contact(pair, found, nearest) && nearest.normal.dot(found) > kMetElsewhere)
    write(nearest.normal, nearest.point, nearest.distance, contact);
}

// A face of a box, or a flat end of a cylinder, across the axis `axis` of its frame.
void meet_face(const mjModel* m, const mjData* d, int ellipsoid, int other, int axis,
               mjPreContact& contact) {
  const Pose pose = unchecked_geom_pose(d, ellipsoid), frame = unchecked_geom_pose(d, other);
  const Vector3d size = size_of(m, other);
  const Vector3d across = frame.rotation.col(axis);
  const double cosine = -across.dot(Vector3d(contact.normal));
  if (std::abs(cosine) < kFoundOnFace) return;
  const Vector3d outward = std::copysign(1.0, cosine) * across;
  const Vector3d lowest = RoundSurfaces(m, ellipsoid).lowest(0, pose)(outward);
  const Vector3d local = frame.rotation.transpose() * (lowest - frame.position);
  const bool is_box = m->geom_type[other] == mjGEOM_BOX;
  const double half = is_box ? size[axis] : size[1];
  const int beside1 = (axis + 1) % 3, beside2 = (axis + 2) % 3;
  const bool over_face = is_box ? std::abs(local[beside1]) <= size[beside1] &&
                                      std::abs(local[beside2]) <= size[beside2]
                                : std::hypot(local[beside1], local[beside2]) <= size[0];
  if (over_face) write(-outward, lowest, outward.dot(lowest - frame.position) - half, contact);
}

}  // namespace

void improve_ellipsoid_contact(const mjModel_* m, const mjData_* d, int ellipsoid, int other,
                               mjPreContact_& contact) {
  switch (m->geom_type[other]) {
    case mjGEOM_ELLIPSOID:
      return meet_ellipsoid(m, d, ellipsoid, other, contact);
    case mjGEOM_CYLINDER:
      return meet_face(m, d, ellipsoid, other, 2, contact);
    case mjGEOM_BOX: {
      int axis = 0;
      const Pose frame = unchecked_geom_pose(d, other);
      (frame.rotation.transpose() * Vector3d(contact.normal)).cwiseAbs().maxCoeff(&axis);
      return meet_face(m, d, ellipsoid, other, axis, contact);
    }
    default:
      return;
  }
}

}  // namespace dashpot::host
