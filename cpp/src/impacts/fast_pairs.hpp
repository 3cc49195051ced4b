// Pairs of geoms whose relative motion in a step is not small against the thinner of the two. Let
//
//     s = a bound on the speed at which any two points of the pair approach, with that which its
//         compressed contacts can still give it in a step, x sqrt(k w) min(1, sqrt(k w) H),
//     e = half the least width of its thinner geom.
//
// A pair is fast where s H > e / 4, or where such motion turns one of the two, or the normal of two
// round ones, by more than 0.05 rad in the step.

#pragma once

#include <array>
#include <vector>

#include "dashpot/geometry/pair_motion.hpp"
#include "dashpot/impacts/geom_pair.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot {

struct FastPair : PairMotion {
  double margin = 0.0;   // m, distance at which contact starts
  bool apart = false;    // from each other, proven for this substep
  double clear = 0.0;    // s, how long it is proven
  bool pressed = false;  // round, with compression remembered
};

// Finds fast pairs, by the motion that a model has now, over what remains of a step.
class FastPairs {
 public:
  // `acceleration` (nv): the mean smooth one over `remaining` (s) of a step of `whole` (s).
  FastPairs(const mjModel_* model, const mjData_* data, const Memory& memory,
            const std::vector<double>& acceleration, double whole, double remaining);

  // Finds the fast pairs among those that collision reports: `pairs`, and by contact the index of
  // its pair, -1 where that is not fast.
  void find(const std::vector<ContactInput>& contacts);
  std::vector<FastPair> pairs;
  std::vector<int> pair_of_contact;

  // Whether a pair is fast that approaches at `speed` (m/s) over `length` (s).
  bool is_fast(const FastPair& pair, double speed, const Eigen::Vector3d& normal,
               double length) const;

 private:
  // What bounds a geom's part in any pair.
  struct Bound {
    double half_width = 0.0;  // m
    double radius = 0.0;      // m, reach of the core about the body's centre of mass
    double speed = 0.0;       // m/s, of its points
    double calm_way = 0.0;    // m, relative motion in a step that asks for nothing
  };
  // A pair whose compressed contacts hold enough to make it fast.
  struct Loaded {
    std::array<int, 2> geom;
    double speed_squared;
  };

  Bound bound_geom(int geom) const;
  double half_width(const GeomPair& geom) const;
  bool is_slow(const GeomPair& geom) const;
  void read_loaded(const Memory& memory);
  double release_speed(const GeomPair& geom) const;
  FastPair make_pair(const ContactInput& contact) const;
  bool is_fast(const FastPair& pair, const ContactInput& contact) const;

  const mjModel_* model_;
  const mjData_* data_;
  const double whole_, remaining_;
  const std::vector<Motion> velocity_, acceleration_;
  std::vector<Bound> bound_;  // by geom
  std::vector<Loaded> loaded_;
  std::vector<std::array<int, 2>> pressed_;
};

}  // namespace dashpot
