#include "dashpot/detection/faces.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dashpot/detection/geometry_host.hpp"
#include "dashpot/detection/side_by_side.hpp"
#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/mujoco/contacts.hpp"

namespace dashpot::host {

namespace {

// Points in which boxes touch that lie in line on each other.
constexpr int kCornersOfBoxes = 4;
// Of faces of boxes as wide as each other edges cross where a hair of turn, or of play, has it; up
// to so flat (face_manifold.hpp) these are no corners: they came and went in a grip, and what they
// bore with them.
constexpr double kFlatCrossing = 1e-3;
constexpr double kAligned = 0.99875;  // cosine between axes of boxes that may be so, 0.05 rad

using Eigen::Vector3d;

// Angle (rad) to a face, and of the contact found to its normal, up to which an edge lies flat on
// it: about one degree, far from rest, and little enough for the normal of the face to stand for
// one across both edges.
constexpr double kFlatEdge = 0.02;
// Fraction of the smaller geom's radius that points of faces may be less deep than the contact
// found.
constexpr double kFaceAsDeep = 1e-4;
// Fraction of the smaller geom's radius that facets which all but lie flat are wide, to count like
// a face.
constexpr double kWide = 0.25;
// Cosine of the angle to an edge from which it runs along a direction no more.
constexpr double kAlong = 0.9;

// Radius about a geom; planes have none.
double size(const mjModel* m, int geom) {
  return m->geom_type[geom] == mjGEOM_PLANE ? mjMAXVAL : m->geom_rbound[geom];
}

// What `make` makes of the vertices and polygons of a mesh's hull, none where the model holds none.
template <typename Make>
auto of_hull(const mjModel* m, int mesh, const Make& make) {
  Eigen::Matrix3Xd vertices(3, m->mesh_vertnum[mesh]);
  const float* const vertex = m->mesh_vert + 3 * m->mesh_vertadr[mesh];
  for (int i = 0; i < vertices.size(); ++i) vertices.data()[i] = vertex[i];
  std::vector<std::vector<int>> polygons(m->mesh_polynum[mesh]);
  for (int i = 0; i < m->mesh_polynum[mesh]; ++i) {
    const int polygon = m->mesh_polyadr[mesh] + i;
    const int* const begin = m->mesh_polyvert + m->mesh_polyvertadr[polygon];
    polygons[i].assign(begin, begin + m->mesh_polyvertnum[polygon]);
  }
  return make(vertices, polygons);
}

const std::vector<FlatFace>& faces_of(const mjModel* m, int mesh, FaceBuffers& buffers) {
  const std::lock_guard<std::mutex> lock(buffers.hulls->mutex);
  buffers.hulls->of_mesh.resize(m->nmesh);
  std::optional<std::vector<FlatFace>>& faces = buffers.hulls->of_mesh[mesh];
  if (!faces) faces = of_hull(m, mesh, flat_faces);
  return *faces;
}

const std::vector<HullFacet>& facets_of(const mjModel* m, int mesh, FaceBuffers& buffers) {
  const std::lock_guard<std::mutex> lock(buffers.hulls->mutex);
  buffers.hulls->facets_of_mesh.resize(m->nmesh);
  std::optional<std::vector<HullFacet>>& facets = buffers.hulls->facets_of_mesh[mesh];
  if (!facets) facets = of_hull(m, mesh, hull_facets);
  return *facets;
}

// The face of a geom, a box, a mesh or a cylinder, that looks along a direction.
struct Side {
  int geom = -1, type = -1;
  Pose pose;
  const FlatFace* face = nullptr;  // of a mesh
  Vector3d normal = Vector3d::Zero();

  Side(const mjModel* m, const mjData* d, int id)
      : geom(id), type(m->geom_type[id]), pose(unchecked_geom_pose(d, id)) {}

  // Whether there is any.
  bool find(const mjModel* m, const Vector3d& direction, FaceBuffers& buffers) {
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

  bool is_flat(const Vector3d& direction) const {
    return normal.dot(direction) >= (face ? face->cosine : std::cos(kMostTilt));
  }

  // `up`: out of what it lies on.
  PlacedFace place(const mjModel* m, const Vector3d& up) const {
    const mjtNum* const size = m->geom_size + 3 * geom;
    if (face) return place_face(*face, pose, up);
    if (type == mjGEOM_CYLINDER) return place_cap(size[0], size[1], pose, normal, up);
    return place_box_face(Eigen::Map<const Vector3d>(size), pose, normal);
  }
};

FaceManifold meet_plane(const mjModel* m, const mjData* d, int plane, int geom,
                        const Vector3d& normal, double margin, FaceBuffers& buffers) {
  Side side(m, d, geom);
  if (!side.find(m, -normal, buffers) || !side.is_flat(-normal)) return {};
  return dashpot::meet_plane(unchecked_geom_pose(d, plane).position, normal, side.place(m, normal),
                             margin);
}

// Finds what of a mesh all but lies flat on something, `width` (m) wide; `up`: out of that.
bool find_cap(const mjModel* m, const Side& mesh, const Vector3d& up, double width,
              FaceBuffers& buffers) {
  return mesh.type == mjGEOM_MESH &&
         buffers.cap.find(facets_of(m, m->geom_dataid[mesh.geom], buffers), mesh.pose, up, width);
}

// Whether each axis of a box is nearly one of another box.
bool are_aligned(const mjData* d, int geom1, int geom2) {
  using Rotation = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>;
  const Eigen::Matrix3d turn =
      Rotation(d->geom_xmat + 9 * geom1).transpose() * Rotation(d->geom_xmat + 9 * geom2);
  return turn.cwiseAbs().rowwise().maxCoeff().minCoeff() > kAligned;
}

// None where neither face is flat.
FaceManifold meet_faces(const mjModel* m, const mjData* d, int geom1, int geom2,
                        const mjPreContact& contact, double margin, FaceBuffers& buffers) {
  const Vector3d direction = Eigen::Map<const Vector3d>(contact.normal);
  Side side1(m, d, geom1), side2(m, d, geom2);
  const bool flat1 = side1.find(m, direction, buffers) && side1.is_flat(direction);
  const bool flat2 = side2.find(m, -direction, buffers) && side2.is_flat(-direction);
  if (!flat1 && !flat2) return {};
  const double smaller = std::min(m->geom_rbound[geom1], m->geom_rbound[geom2]);
  if (const Side& flat = flat1 ? side1 : side2, &other = flat1 ? side2 : side1;
      flat1 != flat2 && std::abs(flat.normal.dot(direction)) > std::cos(kShallow) &&
      find_cap(m, other, flat.normal, kWide * smaller, buffers)) {
    FaceManifold faces = meet_cap(flat.place(m, -flat.normal), buffers.cap, margin,
                                  Eigen::Map<const Vector3d>(contact.pos), kFaceAsDeep * smaller);
    if (!flat1) faces.normal = -faces.normal;
    return faces;
  }
  if ((side1.type == mjGEOM_MESH && !side1.face) || (side2.type == mjGEOM_MESH && !side2.face))
    return {};
  if (flat1 != flat2) {
    const Vector3d& normal = flat1 ? side1.normal : side2.normal;
    if (std::abs(normal.dot(direction)) < std::cos(kFlatEdge)) return {};
    (flat1 ? side2 : side1).find(m, -normal, buffers);
  }
  const PlacedFace face1 = side1.place(m, side2.normal), face2 = side2.place(m, side1.normal);
  const bool first = flat1 && (!flat2 || separates_farther(face1, face2));
  const bool boxes = side1.type == mjGEOM_BOX && side2.type == mjGEOM_BOX;
  const double flat = boxes && -side1.normal.dot(side2.normal) > kOfFace ? kFlatCrossing : 0.0;
  FaceManifold faces =
      first ? meet_face(face1, face2, margin, flat) : meet_face(face2, face1, margin, flat);
  if (flat1 != flat2) keep_flat_edge(std::tan(kFlatEdge), faces);
  if (!first) faces.normal = -faces.normal;
  return faces;
}

// Whether a geom lies with a round side across a direction.
bool lies_on_side(const mjModel* m, const mjData* d, int geom, const Vector3d& direction) {
  return has_round_side(m->geom_type[geom]) &&
         std::abs(unchecked_geom_pose(d, geom).rotation.col(2).dot(direction)) <
             std::sin(kMostTilt);
}

// None where what it lies on is no face.
FaceManifold meet_side(const mjModel* m, const mjData* d, int geom, int round,
                       const Vector3d& direction, double margin, FaceBuffers& buffers) {
  Side side(m, d, geom);
  if (!has_faces(side.type) || !side.find(m, direction, buffers) || !side.is_flat(direction) ||
      side.normal.dot(direction) < std::cos(kFlatEdge))
    return {};
  const mjtNum* const size = m->geom_size + 3 * round;
  const PlacedFace line = place_side(size[0], size[1], m->geom_type[round] == mjGEOM_CAPSULE,
                                     unchecked_geom_pose(d, round), side.normal);
  return meet_face(side.place(m, -side.normal), line, margin);
}

// Where they lie flat on each other; `contact` is the one found of the nearest points.
FaceManifold meet_geoms(const mjModel* m, const mjData* d, int geom1, int geom2,
                        const mjPreContact& contact, double margin, FaceBuffers& buffers) {
  const Vector3d direction = Eigen::Map<const Vector3d>(contact.normal);
  if (m->geom_type[geom1] == mjGEOM_PLANE)
    return meet_plane(m, d, geom1, geom2, direction, margin, buffers);
  const bool side1 = lies_on_side(m, d, geom1, direction);
  const bool side2 = lies_on_side(m, d, geom2, direction);
  if (side1 && side2) return {};
  if (side2) return meet_side(m, d, geom1, geom2, direction, margin, buffers);
  if (side1) {
    FaceManifold faces = meet_side(m, d, geom2, geom1, -direction, margin, buffers);
    faces.normal = -faces.normal;
    return faces;
  }
  for (int geom : {geom1, geom2}) {
    Side end(m, d, geom);
    if (!has_faces(end.type)) return {};
    // The side of a cylinder is no face.
    if (end.type == mjGEOM_CYLINDER &&
        std::abs(end.pose.rotation.col(2).dot(direction)) < std::cos(kMostTilt))
      return {};
  }
  return meet_faces(m, d, geom1, geom2, contact, margin, buffers);
}

}  // namespace

bool has_faces(int type) {
  return type == mjGEOM_BOX || type == mjGEOM_MESH || type == mjGEOM_CYLINDER;
}

bool has_face_along(const mjModel_* m, const mjData_* d, int geom, const Vector3d& direction,
                    double cosine, FaceBuffers& buffers) {
  return face_normal_along(m, d, geom, direction, cosine, buffers).has_value();
}

std::optional<Vector3d> face_normal_along(const mjModel_* m, const mjData_* d, int geom,
                                          const Vector3d& direction, double cosine,
                                          FaceBuffers& buffers) {
  Side side(m, d, geom);
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
  return place_face(*face, pose, -direction);
}

std::optional<std::array<Vector3d, 2>> edge_through(const mjModel_* m, const mjData_* d, int geom,
                                                    const Vector3d& point, const Vector3d& outward,
                                                    const Vector3d& along, double tolerance,
                                                    FaceBuffers& buffers) {
  Side side(m, d, geom);
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

int take_points_of_faces(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                         FaceBuffers& buffers, mjPreContact_* contact, int count) {
  const int type1 = m->geom_type[geom1], type2 = m->geom_type[geom2];
  // Of boxes MuJoCo gives all points but where it finds edges that cross, of a capsule on one both
  // but where it finds one end; of boxes as wide as each other also points that nothing rests on.
  const bool boxes = type1 == mjGEOM_BOX && type2 == mjGEOM_BOX;
  if (type2 == mjGEOM_BOX && type1 == mjGEOM_PLANE) return 0;
  if (type2 == mjGEOM_BOX && type1 == mjGEOM_CAPSULE && count != 1) return 0;
  if (boxes && count > 1 && (count <= kCornersOfBoxes || !are_aligned(d, geom1, geom2))) return 0;
  if (count == 0) return 0;
  double deepest = contact->dist;
  for (int i = 1; i < count; ++i) deepest = std::min(deepest, contact[i].dist);
  if (boxes && count > 1 && deepest >= 0.0) return 0;
  const FaceManifold faces = meet_geoms(m, d, geom1, geom2, *contact, margin, buffers);
  // A single one stays MuJoCo's, along its own normal.
  if (faces.count == 0 || (faces.count == 1 && count == 1)) return 0;
  if (boxes && count > 1 && (faces.dropped == 0 || faces.count >= count)) return 0;
  double least = margin;
  for (int i = 0; i < faces.count; ++i) least = std::min(least, faces.point[i].distance);
  if (least > deepest + kFaceAsDeep * std::min(size(m, geom1), size(m, geom2))) return 0;
  for (int i = 0; i < faces.count; ++i) {
    contact[i].dist = faces.point[i].distance;
    mju_copy3(contact[i].pos, faces.point[i].position.data());
    mju_copy3(contact[i].normal, faces.normal.data());
    mju_zero3(contact[i].tangent);
  }
  return faces.count;
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
