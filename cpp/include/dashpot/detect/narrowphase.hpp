// Contacts of pairs of geoms.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/candidates.hpp"
#include "dashpot/detect/narrowing.hpp"
#include "dashpot/detect/scratch.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

// Finds contacts, and puts them into mjData in the order of mj_collision. Keeps its arrays.
class Narrowphase {
 public:
  // To be called where positions, velocities or the time step have changed.
  void forget() { now_.pairs.clear(); }
  // Pairs that were asked already, within the same distance, are not collided again. While
  // collisions are replaced in this thread; in others by `faces`, as in ReplacedCollisions.
  void find(mjModel_* m, mjData_* d, const std::vector<CandidatePair>& pairs, FaceBuffers* faces,
            Scratch& scratch, Team& team);

  // Stops with MuJoCo's warning where they do not fit into the memory of the model.
  void write(mjModel_* m, mjData_* d, Team& team) const;

 private:
  // What a collision says of one contact, in the world.
  struct FoundContact {
    double distance;                                  // m
    std::array<double, 3> position, normal, tangent;  // m; no tangent: zeros
  };
  // Contacts of one pair, count of them from the first of all.
  struct FoundPair {
    CandidatePair pair;
    int first, count;
  };
  struct Found {
    std::vector<FoundPair> pairs;
    std::vector<FoundContact> contacts;
  };
  void find_in(const mjModel_* m, mjData_* d, const CandidatePair* first, const CandidatePair* last,
               Found& found);

  Found before_, now_;
  std::vector<Found> found_;  // what threads find, by range of pairs, until it is put together
  PairsApart apart_;
};

}  // namespace dashpot::host
