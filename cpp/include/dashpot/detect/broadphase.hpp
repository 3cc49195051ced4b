// What a geom may collide with.

#pragma once

#include <vector>

#include "dashpot/detect/reach.hpp"

namespace dashpot::host {

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
