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

#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <optional>
#include <unordered_map>

#include "dashpot/detect/pair_filters.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

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
