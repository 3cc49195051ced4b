#include "dashpot/mujoco_side_by_side.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Sine of the angle between the axes across the normal, and of that of each axis to the normal's
// plane, below which they lie side by side. Above it a tilt moves the nearest point by less than
// 11 d for each radian, little in a step.
constexpr double kSideBySide = 0.3;
// Parts of the smaller radius: the tolerance, which is what rigid contacts may sag by (kRigidSag),
// and the length of a line below which its ends are as good as one point.
constexpr double kSag = 1e-3;
constexpr double kShortest = 0.05;

// The part of a geom with a straight side.
struct Bar {
  Vector3d centre, axis;
  double radius, half_length;
  double cap;  // radius beyond the ends

  Bar(const mjModel* m, const mjData* d, int geom)
      : centre(d->geom_xpos + 3 * geom),
        axis(d->geom_xmat[9 * geom + 2], d->geom_xmat[9 * geom + 5], d->geom_xmat[9 * geom + 8]),
        radius(m->geom_size[3 * geom]),
        half_length(m->geom_size[3 * geom + 1]),
        cap(m->geom_type[geom] == mjGEOM_CAPSULE ? radius : 0.0) {}
};

}  // namespace

bool has_round_side(int type) { return type == mjGEOM_CAPSULE || type == mjGEOM_CYLINDER; }

int take_ends_of_sides(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                       mjPreContact_* contact) {
  const Bar first(m, d, geom1);
  Bar second(m, d, geom2);
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
  const double radius = std::min(first.radius, second.radius);
  if (end - begin < kShortest * radius) return 1;
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

}  // namespace dashpot::host
