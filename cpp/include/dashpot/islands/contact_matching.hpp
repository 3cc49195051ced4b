// Which remembered contact each contact of a step goes on from: the nearest of its pair. Of those
// that are nearest to the same one the nearest has it, since a compression that two inherit would
// be two springs as deep, and the others have the nearest that is left. Points that move along
// both geoms, as those of crossing rods, may have passed half of their spacing in a step: what is
// nearest to one of them then is where another was.

#pragma once

#include <limits>
#include <vector>

#include "dashpot/geometry/slots_by_pair.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class ContactMatching {
 public:
  // Finds the match of every group of `rows`; those of constraints have none.
  void find(const Memory& memory, const std::vector<ContactInput>& contacts, const Rows& rows,
            std::vector<Match>& matches, Team& team);

 private:
  struct Nearest {
    int slot = -1;
    double squared_distance = std::numeric_limits<double>::infinity();  // m^2
  };
  Nearest nearest_contact(const Memory& memory, const ContactInput& input) const;
  void inherit(const Memory& memory, const std::vector<ContactInput>& contacts, const Rows& rows,
               int group, std::vector<Match>& matches);
  void match_at_internal_edges(const Memory& memory, const std::vector<ContactInput>& contacts,
                               const Rows& rows, std::vector<Match>& matches);

  SlotsByPair slots_;
  std::vector<Nearest> nearest_;  // by group
  std::vector<int> heir_;         // by slot: the group that goes on from it, -1: none
  std::vector<double> away_;      // by slot: its squared distance
};

}  // namespace dashpot
