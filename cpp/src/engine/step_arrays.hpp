// What a step finds by tree, row, contact or degree of freedom, by what it is for; kept from step
// to step for the arrays.

#pragma once

#include <vector>

#include "dashpot/lanes/aligned.hpp"

namespace dashpot {

// By tree, what rows did to it in the part, see RowsOnTree.
struct RowsOnTrees {
  std::vector<char> touched;   // moved it
  std::vector<char> joined;    // moved another one against it
  std::vector<char> carries;   // some of these are contacts
  std::vector<char> held;      // had a position as they moved it
  std::vector<double> unpaid;  // J, work of contacts, because they turn, that no spring paid for
  std::vector<double> lost;    // J, what they gave it and it does not have

  void reset(int trees) {
    for (auto* array : {&touched, &joined, &carries, &held}) array->assign(trees, 0);
  }
};

// Forces of the part, generalized but where said otherwise.
struct ForcesOfRows {
  std::vector<double> constraint;  // of the micro-steps: under these MuJoCo moves trees
  // By row, and by motion coordinate: impulses of what rows bore of changes of velocity beside the
  // micro-steps (holding_rows.hpp).
  std::vector<double> borne, borne_wrench;
  std::vector<double> of_row;         // by row, with these
  std::vector<char> contact_touched;  // by place in d->contact
  // With what rows bore, where anything is reported otherwise than MuJoCo's integrator takes it;
  // what that takes, while MuJoCo's fields hold these.
  bool report_more = false;
  std::vector<double> reported, reported_acceleration;
};

// How far the part took trees, generalized but where said otherwise.
struct WaysOfTrees {
  std::vector<double> mean;            // what the change of kinetic energy goes with
  std::vector<double> added_velocity;  // see gets_second_half_in_flight
  std::vector<double> recovery;        // of equalities, in motion coordinates
  std::vector<double> recovered;       // the same, generalized
  // Of RK4: where micro-steps take trees, in motion coordinates, and how much farther than in its
  // stages they go.
  AlignedDoubles of_microsteps;
  std::vector<double> beyond_stages;
  // What springs that act in the micro-steps changed by in the mean over the way. Empty where none
  // act there.
  std::vector<double> spring_change;
};

// What knock_on.hpp asks of the part.
struct MeanMotion {
  std::vector<double> velocity;  // generalized
  std::vector<double> end_gap;   // by contact, m
};

// Of the complementarity-free law, per group.
struct ComFreeGroups {
  std::vector<double> gap, effective_mass;
};

}  // namespace dashpot
