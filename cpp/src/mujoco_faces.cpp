#include "dashpot/mujoco_faces.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/face_manifold.hpp"
#include "dashpot/mujoco_host.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

Pose pose_of(const mjData* d, int geom) {
  using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  return {Eigen::Map<const Vector3d>(d->geom_xpos + 3 * geom),
          Eigen::Map<const RowMajor>(d->geom_xmat + 9 * geom)};
}

// None where the model holds no polygons of its hull.
std::vector<FlatFace> faces_of_mesh(const mjModel* m, int mesh) {
  Eigen::Matrix3Xd vertices(3, m->mesh_vertnum[mesh]);
  const float* const vertex = m->mesh_vert + 3 * m->mesh_vertadr[mesh];
  for (int i = 0; i < vertices.size(); ++i) vertices.data()[i] = vertex[i];
  std::vector<std::vector<int>> polygons(m->mesh_polynum[mesh]);
  for (int i = 0; i < m->mesh_polynum[mesh]; ++i) {
    const int polygon = m->mesh_polyadr[mesh] + i;
    const int* const begin = m->mesh_polyvert + m->mesh_polyvertadr[polygon];
    polygons[i].assign(begin, begin + m->mesh_polyvertnum[polygon]);
  }
  return flat_faces(vertices, polygons);
}

const std::vector<FlatFace>& faces_of(const mjModel* m, int mesh, FaceBuffers& buffers) {
  buffers.of_mesh.resize(m->nmesh);
  std::optional<std::vector<FlatFace>>& faces = buffers.of_mesh[mesh];
  if (!faces) faces = faces_of_mesh(m, mesh);
  return *faces;
}

// The side of a geom that faces along a direction: what is to be placed of it.
struct Side {
  int geom, type;
  Pose pose;
  const FlatFace* face = nullptr;  // of a mesh
  Vector3d normal = Vector3d::Zero();
  PlacedFace placed;
};

// Whether the side is flat there.
bool find_face(const mjModel* m, const Vector3d& direction, FaceBuffers& buffers, Side& side) {
  if (side.type == mjGEOM_MESH) {
    side.face = face_along(faces_of(m, m->geom_dataid[side.geom], buffers),
                           side.pose.rotation.transpose() * direction);
    if (side.face) side.normal = side.pose.rotation * side.face->normal;
    return side.face;
  }
  if (side.type == mjGEOM_BOX) {
    side.placed = place_box_face(Eigen::Map<const Vector3d>(m->geom_size + 3 * side.geom),
                                 side.pose, direction);
    side.normal = side.placed.normal;
    return side.placed.count > 0;
  }
  side.normal = side.pose.rotation.col(2);
  return true;
}

bool has_faces(int type) { return type == mjGEOM_BOX || type == mjGEOM_MESH; }

// Pulls of adhesion act in the points that MuJoCo finds.
bool may_adhere(const mjModel* m, int geom1, int geom2) {
  return m->flg_adhesion &&
         (m->npair > 0 || m->geom_adhesion[geom1] != 0.0 || m->geom_adhesion[geom2] != 0.0);
}

}  // namespace

int take_points_of_faces(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                         FaceBuffers& buffers, mjPreContact_* contact, int count) {
  const int type1 = m->geom_type[geom1], type2 = m->geom_type[geom2];
  if (count == 0 || !has_faces(type2) || (type1 != mjGEOM_PLANE && !has_faces(type1))) return 0;
  // Of boxes MuJoCo gives all points but where it finds edges that cross.
  if (type2 == mjGEOM_BOX && (type1 == mjGEOM_PLANE || count != 1)) return 0;
  if (may_adhere(m, geom1, geom2)) return 0;
  const Eigen::Map<const Vector3d> direction(contact->normal);
  Side first{geom1, type1, pose_of(d, geom1)}, second{geom2, type2, pose_of(d, geom2)};
  if (!find_face(m, direction, buffers, first) || !find_face(m, -direction, buffers, second))
    return 0;
  if (first.face) first.placed = place_face(*first.face, first.pose, second.normal);
  if (second.face) second.placed = place_face(*second.face, second.pose, first.normal);
  const FaceManifold faces =
      type1 == mjGEOM_PLANE ? meet_plane(first.pose.position, first.normal, second.placed, margin)
                            : meet_flat(first.placed, second.placed, margin);
  if (faces.count < 2) return 0;  // MuJoCo's, along its own normal
  for (int i = 0; i < faces.count; ++i) {
    contact[i].dist = faces.point[i].distance;
    mju_copy3(contact[i].pos, faces.point[i].position.data());
    mju_copy3(contact[i].normal, faces.normal.data());
    mju_zero3(contact[i].tangent);
  }
  return faces.count;
}

void add_surplus(const mjModel_* m, mjData_* d, const std::vector<SurplusContact>& surplus) {
  const auto is_of = [](const mjContact& contact, const SurplusContact& c) {
    return contact.geom[0] == c.geom[0] && contact.geom[1] == c.geom[1];
  };
  const int found = d->ncon;
  size_t unmatched = surplus.size();
  for (int from = found - 1; from >= 0; --from)
    while (unmatched > 0 && is_of(d->contact[from], surplus[unmatched - 1])) --unmatched;
  if (unmatched > 0) {
    printf("UNMATCHED\n");
    return;
  }
  for (size_t i = 0; i < surplus.size(); ++i)
    if (mj_addContact(m, d, d->contact + found - 1)) return;
  // MuJoCo keeps the order in which it asked for the pairs.
  int to = d->ncon;
  size_t left = surplus.size();
  for (int from = found - 1; left > 0; --from) {
    for (; left > 0 && is_of(d->contact[from], surplus[left - 1]); --left) {
      const SurplusContact& more = surplus[left - 1];
      mjContact& contact = d->contact[--to] = d->contact[from];
      contact.dist = more.distance;
      mju_copy3(contact.pos, more.position.data());
      set_frame(more.normal.data(), contact.frame);
    }
    d->contact[--to] = d->contact[from];
  }
}

}  // namespace dashpot::host
