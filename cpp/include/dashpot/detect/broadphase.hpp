// What a geom may collide with: which pairs MuJoCo lets collide, and boxes that bound geoms.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/reach.hpp"

namespace dashpot::host {

// Two geoms in the order in which MuJoCo's collisions take their types.
struct CandidatePair {
  std::array<int, 2> geom;
  int defined = -1;     // index of the <pair> that defines it, -1 for none
  unsigned bodies = 0;  // by which MuJoCo orders pairs
  double within = 0.0;  // m, how far apart its contacts are looked for
};

// Two geoms in that order, `defined` by a <pair>, or -1.
CandidatePair pair_of(const mjModel_* m, int geom1, int geom2, int defined);

// MuJoCo's order: by bodies; of two bodies, what <pair>s define first.
bool comes_before(const CandidatePair& a, const CandidatePair& b);

// Whether MuJoCo lets two geoms collide that no <pair> names: by their bits, by bodies that are
// welded or next to each other, and by exclusions. Filters that callbacks add are not asked.
bool may_meet(const mjModel_* m, int geom1, int geom2);

// Distance (m) at which contact of a pair starts, and how far beyond it contacts are detected.
double margin_of(const mjModel_* m, const CandidatePair& pair);
double gap_of(const mjModel_* m, const CandidatePair& pair);

// Whether MuJoCo has a collision for geoms of their types.
bool have_collision(const mjModel_* m, const CandidatePair& pair);

// A box that bounds a geom, along its own axes: by its size, which may be edited alone, or as
// MuJoCo has it for meshes and height fields. Planes have none.
struct BoundingBox {
  double centre[3];    // world, m
  double half[3];      // half-widths, m
  double rotation[9];  // row-major; columns: the axes in the world
};
BoundingBox bounding_box(const mjModel_* m, const mjData_* d, int geom);

// Height (m) of the lowest point of a box over a plane geom.
double height_over_plane(const mjData_* d, int plane, const BoundingBox& box);

// The widest gap (m) that a face of either box leaves, negative for none: a bound on the distance.
double boxes_apart(const BoundingBox& box1, const BoundingBox& box2);

// A geom, and the distance (m) at which contact with it starts.
struct BroadphaseNeighbour {
  int geom = -1;
  double margin = 0.0;
};

// All that MuJoCo lets collide with a geom and that it may come near to. Filters that callbacks add
// are not asked. Keeps its arrays from step to step.
class Broadphase {
 public:
  // How far each geom goes, and how far detection let it go, m; not copied.
  void start(const mjModel_* m, const mjData_* d, const std::vector<double>& way,
             const std::vector<double>& reach);
  // Those whose bounds leave no more than the ways of both and their margin, and whose ways are
  // more than detection knew of. Valid until the next call.
  const std::vector<BroadphaseNeighbour>& of(int geom);

 private:
  // Where the sphere begins, along x, that holds a geom on all its way.
  struct Span {
    double low = 0.0;
    int geom = -1;
  };
  double spheres_apart(int geom1, int geom2) const;
  bool may_come_near(int geom1, int geom2, double margin) const;

  const mjModel_* model_ = nullptr;
  const mjData_* data_ = nullptr;
  const double *displacement_ = nullptr, *reach_ = nullptr;
  std::vector<Span> spans_;  // of geoms that move and have bounds, in ascending order
  double widest_ = 0.0;      // of them, m
  std::vector<int> everywhere_;
  std::vector<BroadphaseNeighbour> neighbours_;
};

// The overlap (m) of two geoms that may come about unknown to their contacts.
double unknown_overlap(const mjModel_* m, int geom1, int geom2);

// The most contacts that MuJoCo finds of two geoms.
int most_contacts(const mjModel_* m, int geom1, int geom2);

// Whether motion at `mean_velocity` (nv) over `length` (s) takes a hinge or slide joint beyond a
// limit that is out of the reach of detection, which is widened then.
bool comes_to_limit(const mjModel_* m, const mjData_* d, const std::vector<double>& mean_velocity,
                    double length, ReachBuffers& reach);

}  // namespace dashpot::host
