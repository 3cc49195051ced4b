// Contacts of bodies that pass over the internal edge to the next tile: which of them are none
// (detect/internal_edges.hpp).

#pragma once

#include <Eigen/Core>

#include "dashpot/detect/geom_faces.hpp"
#include "dashpot/detect/supports.hpp"

namespace dashpot::host {

class EdgePasses {
 public:
  EdgePasses(const mjModel_* m, const mjData_* d, const Supports& supports, FaceBuffers& faces)
      : m_(m), d_(d), supports_(supports), faces_(faces) {}

  // The contact with what bears a geom up to the internal edge that a contact is at, and the side
  // of that geom; none where it is at none.
  ContactSide before_edge(const ContactInput& contact);

 private:
  // How far (m) geoms overlap, negative where they are apart, and how fast (m/s) that grows.
  struct Overlap {
    double now, rate;
  };

  bool may_pass_over(const ContactInput& contact, int side) const;
  bool passes(const ContactInput& contact, int side, ContactSide at);
  Overlap overlap_along(int geom, int other, const Eigen::Vector3d& up,
                        const Eigen::Vector3d& highest, const Eigen::Vector3d& at) const;
  Overlap overlap_with_flush(int geom, int other, const Eigen::Vector3d& face,
                             const Eigen::Vector3d& up, const Eigen::Vector3d& at,
                             bool rolls) const;
  double sag_along(int body, const Eigen::Vector3d& up, int layers) const;

  const mjModel_* m_;
  const mjData_* d_;
  const Supports& supports_;
  FaceBuffers& faces_;
};

}  // namespace dashpot::host
