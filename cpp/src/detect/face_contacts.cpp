#include "face_contacts.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/face_manifold.hpp"

namespace dashpot::host {

namespace {

// Points in which boxes touch that lie in line on each other.
constexpr int kCornersOfBoxes = 4;
// Where edges of boxes as wide as each other cross up to so flat (face_manifold.hpp), these are no
// corners: a hair of turn or play makes them come and go in a grip, with what they bear.
constexpr double kFlatCrossing = 1e-3;
constexpr double kAligned = 0.99875;  // cosine between axes of boxes that may be so, 0.05 rad

using Eigen::Vector3d;

// Angle (rad) to a face, and of the contact found to its normal, up to which an edge lies flat on
// it: about one degree, far from rest, and little enough for the normal of the face to stand for
// one across both edges.
constexpr double kFlatEdge = 0.02;
// Fraction of the smaller geom's radius by which points of faces may be less deep than the contact.
constexpr double kFaceAsDeep = 1e-4;
// Least width of facets that all but lie flat and count like a face, of the smaller geom's radius.
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

// Sine of the angle between the axes across the normal, and of that of each axis to the normal's
// plane, below which they lie side by side. Above it a tilt moves the nearest point by less than
// 11 d for each radian, little in a step.
constexpr double kSideBySide = 0.3;
// Fractions of the smaller radius: the tolerance, which is what rigid contacts may sag by
// (kRigidSag), and the length of a line below which its ends are as good as one point.
constexpr double kSag = 1e-3;
constexpr double kShortestLine = 0.05;
// Sine of the angle of a normal to the plane across an axis up to which it is that of two axes: of
// the end of a cylinder along an edge the gap is then off by a millionth of the radius.
constexpr double kAcross = 0.01;
// Cosine of the angle to the normal found beyond which axes have met elsewhere.
constexpr double kMetElsewhere = 0.9;

// A straight side of a geom.
struct Bar {
  Vector3d centre, axis;
  double radius, half_length;
  double cap;  // radius beyond the ends
};

Bar round_side(const mjModel* m, const mjData* d, int geom) {
  const Pose pose = unchecked_geom_pose(d, geom);
  const double radius = m->geom_size[3 * geom];
  return {pose.position, pose.rotation.col(2), radius, m->geom_size[3 * geom + 1],
          m->geom_type[geom] == mjGEOM_CAPSULE ? radius : 0.0};
}

// The edge of a box or a mesh that touches a round side in all of the contacts found, the nearest
// first. None where there is no such edge.
std::optional<Bar> edge_in(const mjPreContact* contact, int count, const mjModel* m,
                           const mjData* d, int geom, const Bar& round, FaceBuffers& buffers) {
  const double tolerance = kSag * round.radius;
  const auto point_of = [](const mjPreContact& c) -> Vector3d {
    return Vector3d(c.pos) + 0.5 * c.dist * Vector3d(c.normal);
  };
  const Vector3d outward = -Vector3d(contact->normal);
  const auto ends =
      edge_through(m, d, geom, point_of(*contact), outward, round.axis, tolerance, buffers);
  if (!ends) return std::nullopt;
  const auto& [begin, end] = *ends;
  const double length = (end - begin).norm();
  const Bar edge{0.5 * (begin + end), (end - begin) / length, 0.0, 0.5 * length, 0.0};
  for (int i = 1; i < count; ++i)
    if ((point_of(contact[i]) - edge.centre).cross(edge.axis).norm() > tolerance)
      return std::nullopt;
  return edge;
}

// Fraction of the radius about a bar's axis along which its surface is nearest, of a direction that
// rises over the axis: of a cylinder its rim is.
double reach_of(const Bar& bar, double rise) {
  return bar.cap > 0.0 ? bar.radius : bar.radius * std::sqrt(1.0 - rise * rise);
}

// Puts what the nearest points of the axes give in place of those that a search found, where both
// lie across them. It ends with a tolerance on the distance, which leaves the normal open.
void meet_axes(const Bar& first, const Bar& second, mjPreContact& contact) {
  const auto clamped = [](const Bar& bar, double at) {
    return std::clamp(at, -bar.half_length, bar.half_length);
  };
  const auto foot = [&](const Bar& bar, const Vector3d& point) {
    return clamped(bar, bar.axis.dot(point - bar.centre));
  };
  const Vector3d across = first.axis.cross(second.axis);
  const double square = across.squaredNorm();
  double at1 = foot(first, Vector3d(contact.pos));
  if (square > 0.0)  // that of parallel ones may be anywhere
    at1 = clamped(first, (second.centre - first.centre).cross(second.axis).dot(across) / square);
  const double at2 = foot(second, first.centre + at1 * first.axis);
  const Vector3d on_second = second.centre + at2 * second.axis;
  at1 = foot(first, on_second);
  const Vector3d on_first = first.centre + at1 * first.axis;
  const Vector3d between = on_second - on_first;
  const double apart = between.norm();
  const Vector3d normal = between / apart;
  const double rise1 = normal.dot(first.axis), rise2 = normal.dot(second.axis);
  if (!(normal.dot(Vector3d(contact.normal)) > kMetElsewhere) ||
      std::max(std::abs(rise1), std::abs(rise2)) > kAcross)
    return;
  const double reach1 = reach_of(first, rise1), reach2 = reach_of(second, rise2);
  contact.dist = apart - reach1 - reach2;
  Eigen::Map<Vector3d>(contact.normal) = normal;
  Eigen::Map<Vector3d>(contact.pos) = on_first + (reach1 + 0.5 * contact.dist) * normal;
}

// Puts the ends of where two bars touch in place of their nearest points; returns how many.
int take_ends(const Bar& first, Bar second, double margin, mjPreContact* contact) {
  if (first.axis.dot(second.axis) < 0.0) second.axis = -second.axis;
  const Vector3d normal(contact->normal), nearest(contact->pos);
  const double crossing = std::abs(normal.dot(first.axis.cross(second.axis)));
  const double rise1 = normal.dot(first.axis), rise2 = normal.dot(second.axis);
  if (std::max({crossing, std::abs(rise1), std::abs(rise2)}) > kSideBySide) return 1;
  // From the nearest point on, as far as the straight sides of both go.
  const Vector3d on_first = nearest - (first.cap + 0.5 * contact->dist) * normal;
  const Vector3d on_second = nearest + (second.cap + 0.5 * contact->dist) * normal;
  const double at1 = first.axis.dot(on_first - first.centre);
  const double at2 = second.axis.dot(on_second - second.centre);
  double begin = std::min(0.0, std::max(-first.half_length - at1, -second.half_length - at2));
  double end = std::max(0.0, std::min(first.half_length - at1, second.half_length - at2));
  const double radius = second.radius > 0.0 ? std::min(first.radius, second.radius) : first.radius;
  if (end - begin < kShortestLine * radius) return 1;
  const double apart = std::max(0.0, first.radius + second.radius + contact->dist);
  const double touching =
      std::sqrt(2.0 * apart * kSag * radius) / crossing;  // infinite where parallel
  begin = std::max(begin, -touching);
  end = std::min(end, touching);
  const Vector3d along = 0.5 * (first.axis + second.axis);
  const mjPreContact of_nearest = *contact;
  int count = 0;
  for (double x : {begin, end}) {
    mjPreContact& c = contact[count] = of_nearest;
    c.dist += (rise2 - rise1) * x;
    if (c.dist > margin) continue;
    Eigen::Map<Vector3d>(c.pos) = nearest + x * along;
    ++count;
  }
  return count;
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

bool has_round_side(int type) { return type == mjGEOM_CAPSULE || type == mjGEOM_CYLINDER; }

int take_ends_of_sides(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                       FaceBuffers& buffers, mjPreContact_* contact, int count) {
  const Bar first = round_side(m, d, geom1);
  std::optional<Bar> second;
  if (!has_round_side(m->geom_type[geom2]))
    second = edge_in(contact, count, m, d, geom2, first, buffers);
  else if (count == 1)
    second = round_side(m, d, geom2);
  if (!second) return count;
  meet_axes(first, *second, *contact);
  return take_ends(first, *second, margin, contact);
}

}  // namespace dashpot::host
