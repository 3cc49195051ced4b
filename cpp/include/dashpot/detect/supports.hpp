// What bodies rest on in a step, or may come to rest on, by its contacts: where internal edges
// between geoms are looked for (detect/internal_edges.hpp).

#pragma once

#include <Eigen/Core>
#include <vector>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

// Cosine between normals that are the same.
inline constexpr double kSameNormal = 0.9999;
// Depths: those of one body under its load differ by less.
inline constexpr double kDepths = 1.5;
// Fraction of the smaller geom's radius that counts as motion in a step.
inline constexpr double kEdgeMotion = 1e-5;

// Whether a geom is round, and another one has flat faces.
bool rolls_on(const mjModel_* m, int geom, int other);

// A contact, and one of its sides; none where the index is negative.
struct ContactSide {
  int index = -1, side = 0;
};

// Kept from step to step: a step allocates nothing.
struct SupportBuffers {
  std::vector<int> first, next;  // chains of contacts, by body and by contact and side
  GeomShapes shapes;
};

class Supports {
 public:
  // `start_reach` (m): how far each geom can move in the step with the velocities of its start.
  Supports(const mjModel_* m, const mjData_* d, const std::vector<double>& start_reach,
           SupportBuffers& buffers, const std::vector<ContactInput>& contacts);

  const ContactInput& contact(ContactSide at) const { return contacts_[at.index]; }
  // The contacts by which a body may be borne, or bear, and its side of each.
  ContactSide first(int body) const { return of_chain(buffers_.first[body]); }
  ContactSide next(ContactSide at) const { return of_chain(buffers_.next[2 * at.index + at.side]); }

  // The body that moves the geom on a side of a contact, or, of one that none does, its own.
  int body_of(const ContactInput& contact, int side) const;
  // What tiles may differ by in height (m), as the smaller of two geoms sees it.
  double tolerance(const ContactInput& contact) const;
  // Speed (m/s) at which a gap closes, or an overlap grows.
  double closing(const ContactInput& contact) const;
  // How far (m) the geoms of a contact can come nearer in the step.
  double reach(const ContactInput& contact) const;
  // The point (world) of a geom that is farthest along a unit direction.
  Eigen::Vector3d support_point(int geom, const Eigen::Vector3d& direction) const;
  // Velocity (m/s) along a direction of a geom's body at a point.
  double rate_along(int geom, const Eigen::Vector3d& direction, const Eigen::Vector3d& point) const;

 private:
  static ContactSide of_chain(int at) {
    return at < 0 ? ContactSide{} : ContactSide{at / 2, at % 2};
  }
  // Whether a body rests on something by a contact, or comes near it in the step.
  bool may_bear(const ContactInput& contact) const;

  const mjModel_* m_;
  const mjData_* d_;
  const std::vector<double>& start_reach_;
  SupportBuffers& buffers_;
  const std::vector<ContactInput>& contacts_;
};

}  // namespace dashpot::host
