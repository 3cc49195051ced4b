#include "face_contacts.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/face_manifold.hpp"
#include "side_by_side.hpp"

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

// Radius about a geom; planes have none.
double size(const mjModel* m, int geom) {
  return m->geom_type[geom] == mjGEOM_PLANE ? mjMAXVAL : m->geom_rbound[geom];
}

FaceManifold meet_plane(const mjModel* m, const mjData* d, int plane, int geom,
                        const Vector3d& normal, double margin, FaceBuffers& buffers) {
  GeomFace side(m, d, geom);
  const Vector3d origin = unchecked_geom_pose(d, plane).position;
  if (side.find(m, -normal, buffers) && side.is_flat(-normal))
    return dashpot::meet_plane(origin, normal, side.place(m, normal), margin);
  if (!find_cap(m, side, normal, kWide * m->geom_rbound[geom], buffers)) return {};
  return buffers.cap.meet_plane(origin, margin);
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
  GeomFace side1(m, d, geom1), side2(m, d, geom2);
  const bool flat1 = side1.find(m, direction, buffers) && side1.is_flat(direction);
  const bool flat2 = side2.find(m, -direction, buffers) && side2.is_flat(-direction);
  if (!flat1 && !flat2) return {};
  const double smaller = std::min(m->geom_rbound[geom1], m->geom_rbound[geom2]);
  if (const GeomFace& flat = flat1 ? side1 : side2, &other = flat1 ? side2 : side1;
      flat1 != flat2 && std::abs(flat.normal.dot(direction)) > std::cos(kShallow) &&
      find_cap(m, other, flat.normal, kWide * smaller, buffers)) {
    FaceManifold faces =
        buffers.cap.meet_face(flat.place(m, -flat.normal), margin,
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
  GeomFace side(m, d, geom);
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
    GeomFace end(m, d, geom);
    if (!has_faces(end.type)) return {};
    // The side of a cylinder is no face.
    if (end.type == mjGEOM_CYLINDER &&
        std::abs(end.pose.rotation.col(2).dot(direction)) < std::cos(kMostTilt))
      return {};
  }
  return meet_faces(m, d, geom1, geom2, contact, margin, buffers);
}

}  // namespace

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

}  // namespace dashpot::host
