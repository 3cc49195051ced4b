// A pair of geoms that fly towards or past each other, and where their motion leads.
//
// The pair is followed along the parabolas of the centres of mass to its time of impact
// (query.hpp), turning at the mean rates of the step, by a clearance that covers what those leave
// out: with the angular accelerations alpha of the bodies and arms r about their centres, over the
// step H
//
//     (|alpha_1| r_1 + |alpha_2| r_2) H^2 / 8 .

#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

namespace host {
struct ReachBuffers;
}

// A pair whose contacts, from `first` to `last`, are all apart, and where its motion leads.
struct Flight {
  size_t first = 0, last = 0;
  bool misses = false, meets = false;  // neither: not followed
  // Of the impact: the normal; the points that meet, from the bodies' centres of mass at the start
  // on with the arms that they have then, and in the frames of their geoms; the gap at the start
  // from which the rates at those points lead to the impact.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  Eigen::Vector3d point[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d local[2] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  double gap = 0.0;
};

// Clearance, relative to the half-width of the thinner geom, that counts as touch of round ones: a
// miss by so little may as well touch.
inline constexpr double kClearance = 1e-3;

// Where bodies go in a step of `length` (s) by their smooth motion, which `reach` has.
class FlightPaths {
 public:
  FlightPaths(const mjModel_* model, const mjData_* data, const host::ReachBuffers& reach,
              double length, GeomShapes& shapes)
      : model_(model), data_(data), reach_(reach), length_(length), shapes_(shapes) {}

  Motion at_start(int body) const;
  Motion at_end(int body) const;
  Motion mean(int body) const;
  // m, of the thinner geom of a contact.
  double half_width(const ContactInput& contact) const;
  bool are_round(const ContactInput& contact) const;

  // Follows the geoms of a contact to where they meet or pass by.
  void follow(const ContactInput& contact, Flight& flight) const;

 private:
  bool one_is_round(const ContactInput& contact) const;

  const mjModel_* model_;
  const mjData_* data_;
  const host::ReachBuffers& reach_;
  double length_;
  GeomShapes& shapes_;
};

}  // namespace dashpot
