// How what has been solved moves in the mean over a part, and where its gaps end: what knock_on.hpp
// asks for.

#pragma once

#include <vector>

#include "dashpot/threads/team.hpp"
#include "solved_part.hpp"

namespace dashpot {

// Keeps its arrays from step to step.
class MeanMotion {
 public:
  void find(const SolvedPart& part, Team& team);
  const std::vector<double>& velocity() const { return velocity_; }  // (nv)
  // By contact, m: where the surfaces are.
  const std::vector<double>& end_gap() const { return end_gap_; }

 private:
  void find_velocity(const SolvedPart& part, Team& team);
  void find_end_gaps(const SolvedPart& part);

  std::vector<double> velocity_, end_gap_;
};

}  // namespace dashpot
