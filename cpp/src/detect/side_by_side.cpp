#include "side_by_side.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/geometry_host.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

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
