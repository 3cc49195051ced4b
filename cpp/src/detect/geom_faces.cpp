#include "dashpot/detect/geom_faces.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/model/contacts.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Cosine of the angle to an edge from which it runs along a direction no more.
constexpr double kAlong = 0.9;

// Hold the mutex.
const CoarseHull& made_hull(const mjModel* m, int mesh, HullFaces& hulls) {
  hulls.of_mesh.resize(m->nmesh);
  std::optional<CoarseHull>& hull = hulls.of_mesh[mesh];
  return hull ? *hull : hull.emplace(coarse_hull(hull_vertices(m, mesh)));
}

const std::vector<FlatFace>& faces_of(const mjModel* m, int mesh, FaceBuffers& buffers) {
  const std::lock_guard<std::mutex> lock(buffers.hulls->mutex);
  buffers.hulls->faces_of_mesh.resize(m->nmesh);
  std::optional<std::vector<FlatFace>>& faces = buffers.hulls->faces_of_mesh[mesh];
  if (!faces) faces = flat_faces(made_hull(m, mesh, *buffers.hulls));
  return *faces;
}

const CoarseHull& hull_of(const mjModel* m, int mesh, FaceBuffers& buffers) {
  const std::lock_guard<std::mutex> lock(buffers.hulls->mutex);
  return made_hull(m, mesh, *buffers.hulls);
}

}  // namespace

GeomFace::GeomFace(const mjModel_* m, const mjData_* d, int id)
    : geom(id), type(m->geom_type[id]), pose(unchecked_geom_pose(d, id)) {}

bool GeomFace::find(const mjModel_* m, const Vector3d& direction, FaceBuffers& buffers) {
  const Vector3d local = pose.rotation.transpose() * direction;
  if (type == mjGEOM_BOX) {
    int axis = 0;
    local.cwiseAbs().maxCoeff(&axis);
    normal = std::copysign(1.0, local[axis]) * pose.rotation.col(axis);
    return true;
  }
  if (type == mjGEOM_CYLINDER) {
    normal = std::copysign(1.0, local.z()) * pose.rotation.col(2);
    return true;
  }
  face = face_along(faces_of(m, m->geom_dataid[geom], buffers), local);
  if (face) normal = pose.rotation * face->normal;
  return face;
}

bool GeomFace::is_flat(const Vector3d& direction) const {
  return normal.dot(direction) >= (face ? face->cosine : std::cos(kMostTilt));
}

PlacedFace GeomFace::place(const mjModel_* m, const Vector3d& up) const {
  const mjtNum* const size = m->geom_size + 3 * geom;
  if (face) return place_face(*face, pose);
  if (type == mjGEOM_CYLINDER) return place_cap(size[0], size[1], pose, normal, up);
  return place_box_face(Eigen::Map<const Vector3d>(size), pose, normal);
}

bool find_cap(const mjModel_* m, const GeomFace& mesh, const Vector3d& up, double width,
              FaceBuffers& buffers) {
  return mesh.type == mjGEOM_MESH &&
         buffers.cap.find(hull_of(m, m->geom_dataid[mesh.geom], buffers), mesh.pose, up, width);
}

bool has_faces(int type) {
  return type == mjGEOM_BOX || type == mjGEOM_MESH || type == mjGEOM_CYLINDER;
}

std::optional<Vector3d> face_normal_along(const mjModel_* m, const mjData_* d, int geom,
                                          const Vector3d& direction, double cosine,
                                          FaceBuffers& buffers) {
  GeomFace side(m, d, geom);
  if (!has_faces(side.type) || !side.find(m, direction, buffers) ||
      side.normal.dot(direction) < cosine)
    return std::nullopt;
  return side.normal;
}

std::optional<PlacedFace> flat_face_along(const mjModel_* m, int geom, const Pose& pose,
                                          const Vector3d& direction, double tilt,
                                          FaceBuffers& buffers) {
  const Vector3d local = pose.rotation.transpose() * direction;
  const FlatFace* const face = face_along(faces_of(m, m->geom_dataid[geom], buffers), local);
  if (!face || face->normal.dot(local) < std::max(face->cosine, std::cos(tilt)))
    return std::nullopt;
  return place_face(*face, pose);
}

std::optional<std::array<Vector3d, 2>> edge_through(const mjModel_* m, const mjData_* d, int geom,
                                                    const Vector3d& point, const Vector3d& outward,
                                                    const Vector3d& along, double tolerance,
                                                    FaceBuffers& buffers) {
  GeomFace side(m, d, geom);
  if (!side.find(m, outward, buffers)) return std::nullopt;
  const PlacedFace face = side.place(m, -outward);
  std::optional<std::array<Vector3d, 2>> edge;
  double nearest = tolerance;
  for (int i = 0; i < face.count; ++i) {
    const Vector3d& begin = face.corner[i];
    const Vector3d& end = face.corner[(i + 1) % face.count];
    const double length = (end - begin).norm();
    if (length == 0.0 || std::abs(along.dot(end - begin)) < kAlong * length) continue;
    const double distance = (point - begin).cross(end - begin).norm() / length;
    if (distance > nearest) continue;
    nearest = distance;
    edge = {begin, end};
  }
  return edge;
}

bool add_surplus(mjData_* d, const std::vector<SurplusContact>& surplus) {
  const auto is_of = [](const mjContact& contact, const SurplusContact& c) {
    return contact.geom[0] == c.geom[0] && contact.geom[1] == c.geom[1];
  };
  // In the order of their pairs, as MuJoCo asks for them: backwards, from the last to the first.
  const int found = d->ncon, count = static_cast<int>(surplus.size());
  int left = count;
  for (int from = found - 1; from >= 0; --from)
    while (left > 0 && is_of(d->contact[from], surplus[left - 1])) --left;
  if (left > 0) return false;  // MuJoCo had no room for the others of a pair
  if (!make_room_for_contacts(d, count)) return false;
  left = count;
  for (int from = found - 1, to = d->ncon; left > 0; --from) {
    for (; left > 0 && is_of(d->contact[from], surplus[left - 1]); --left) {
      const SurplusContact& more = surplus[left - 1];
      mjContact& contact = d->contact[--to] = d->contact[from];
      contact.dist = more.distance;
      mju_copy3(contact.pos, more.position.data());
      set_frame(more.normal.data(), contact.frame);
    }
    d->contact[--to] = d->contact[from];
  }
  return true;
}

}  // namespace dashpot::host
