// The contacts of one geom with a terrain, in the frame of that.

#pragma once

#include <Eigen/Core>
#include <array>

#include "dashpot/geometry/terrain.hpp"

namespace dashpot {

// Fractions of the geom's radius: by how much a contact may be less deep than one that it stands
// for.
inline constexpr double kAsDeep = 1e-5;

struct TerrainContact {
  Eigen::Vector3d position, normal;  // halfway between the surfaces, m; unit, out of the terrain
  double distance = 0.0;             // m, negative in overlap
  int surface = -1;                  // of the geom's round ones that touches; -1 where none does
};

// Whether contacts of a round surface with two planes, found where their lowest points lie over
// triangles of them, are one: `deepest` (m) the smaller of their distances, `apart` (m) how far
// apart they are, `turn` the distance of their normals, `approach` (m) that of the step along it.
//
// Under the radius r planes that differ by the angle a are touched a r apart, each from where the
// other is a^2 r / 2 deep on. A surface that lies deeper has touched the second before it is found,
// and then two springs would bear what one does. What is rigid meets the second within a step of
// coming to lie over it, and hits it.
bool are_in_one_place(double deepest, double apart, double turn, double approach);

class TerrainContacts {
 public:
  static constexpr int kRoom = 50;

  // `radius` (m) of the geom about its centre.
  explicit TerrainContacts(double radius) : radius_(radius) {}

  int count() const { return count_; }
  const TerrainContact* begin() const { return contact_.data(); }
  const TerrainContact* end() const { return contact_.data() + count_; }

  // The nearest stay where there is no room for all.
  void add(const TerrainContact& contact);
  // Whether one that is as deep stands for one within `place` (m), of normals within `cosine`.
  bool has(const Eigen::Vector3d& position, const Eigen::Vector3d& normal, double distance,
           double place, double cosine) const;
  // Whether one of a round surface is on the plane of a triangle about a point of the geom.
  bool has_on_plane(const TerrainTriangle& triangle, const Eigen::Vector3d& point,
                    int surface) const;
  double deepest() const;  // least distance (m), 0 where nothing overlaps
  // Of those of a round surface that are in one place the deepest stays; `way` (m) of the geom in
  // the step.
  void merge(const Eigen::Vector3d& way);

 private:
  double radius_;
  std::array<TerrainContact, kRoom> contact_;
  int count_ = 0;
};

}  // namespace dashpot
