// How far apart contacts of a pair of geoms are looked for.
//
// The reach of every geom is how far it goes in the world (detect/reach.hpp), but links of a
// robot go together. A pair is narrowed to how far its geoms may go against each other, at the
// velocities of both ends of the step. What forces of the step add to that is looked at afterwards
// (impact_propagation.hpp); a pair that an impact is known to bring together is looked for by its
// ways in the world.

#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "dashpot/detect/candidates.hpp"

namespace dashpot::host {

// Keeps its array from step to step.
class Narrowing {
 public:
  // `reach` is to outlive its use.
  void start(const ReachBuffers& reach);
  // The distance (m) within which contacts of a pair are looked for, pair.within or less; where it
  // is less, the pair is appended to `narrowed`.
  double within(const mjModel_* m, const mjData_* d, const CandidatePair& pair,
                std::vector<NarrowedPair>& narrowed) const;
  // Those of the present detection.
  std::vector<NarrowedPair>& pairs() { return pairs_; }

 private:
  const ReachBuffers* reach_ = nullptr;
  std::vector<NarrowedPair> pairs_;
};

// Pairs of geoms known to be apart, kept over steps.
//
// MuJoCo finds distances of meshes by search, a microsecond for each pair that does not touch, as
// links of an arm do not from one step to the next. A distance once found is one at present less
// the way that either geom has gone against the other since, in its frame: a point at most r from
// the centre of one that is shifted by t and turned by R goes no farther than
//
//     |t| + 2 r sin(angle / 2) = |t| + r |R - 1|_F / sqrt(2) .
//
// Which contacts there are does not depend on what was kept: what is left out has none. Geoms whose
// kind, size, mesh or bounds were edited are asked anew; a mesh whose vertices alone are is not.
// Threads may ask at the same time.
class PairsApart {
 public:
  // Before pairs are asked about: makes room where too many are kept.
  void make_room();
  // Whether a pair is known to be more than `within` (m) apart.
  bool are_apart(const mjModel_* m, const mjData_* d, const CandidatePair& pair, double within);
  // To be called where no contact of a pair was found within that distance: finds how far apart the
  // two are, where it is worth that.
  void find_distance(const mjModel_* m, mjData_* d, const CandidatePair& pair, double within);

 private:
  // The second geom in the frame of the first, and what bounds both.
  struct Placement {
    std::array<double, 3> position;
    std::array<double, 9> rotation;
    std::array<double, 24> extent;  // sizes, radii and bounds (m), kinds and meshes
  };
  struct Known {
    Placement placement;    // where the distance was found
    double distance = 0.0;  // m
    int waits = 0;          // how often it is not looked for yet
  };
  static Placement place(const mjModel_* m, const mjData_* d, const CandidatePair& pair);
  std::optional<Known> known(const CandidatePair& pair);
  void keep(const CandidatePair& pair, const Known& known);

  std::mutex mutex_;  // of what is kept
  std::unordered_map<std::uint64_t, Known> known_;
};

}  // namespace dashpot::host
