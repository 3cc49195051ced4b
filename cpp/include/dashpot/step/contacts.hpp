// Contacts and energies as users read them after a step.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot {

// The contacts of the last step, one entry each. Geometry is the one that rows had, of the start of
// the step or, of what turns, of its middle; velocity that at the start, forces the mean of the
// step, compression, displacement and sticking those at its end. Of a step in substeps all are of
// its last substep. Vectors are in the contact frame (normal from geom 1 to geom 2, two tangents),
// relative motion and force those of geom 2 relative to, and exerted by, geom 1.
struct ContactReport {
  std::vector<std::array<int, 2>> geom;             // ids; -1 where that side is a flex
  std::vector<std::array<int, 2>> flex;             // ids; -1 where that side is a geom
  std::vector<std::array<double, 3>> position;      // m, world
  std::vector<std::array<double, 9>> frame;         // rows: normal, tangent 1, tangent 2; world
  std::vector<double> gap;                          // m, negative in overlap
  std::vector<std::array<double, 3>> velocity;      // m/s
  std::vector<std::array<double, 3>> force;         // N
  std::vector<std::array<double, 3>> torque;        // N m
  std::vector<double> compression;                  // m, of the normal spring
  std::vector<std::array<double, 3>> displacement;  // m, elastic: normal (-compression), sliding
  std::vector<char> sticking;
};
ContactReport report_contacts(const mjModel_* m, mjData_* d, int contact_capacity);

EnergyLedger read_ledger(const mjModel_* m, mjData_* d, int contact_capacity);
// Kinetic and potential energy of the present state, J, with mocap bodies where they are on the way
// to their commands. Evaluated in `scratch`, other data of the same model, so that what the last
// step computed in `d` stays.
std::array<double, 2> mechanical_energy(const mjModel_* m, const mjData_* d, mjData_* scratch,
                                        int contact_capacity);

// Room that memory for so many contacts takes in the user data of this model. Users may edit what
// host::contact_capacity() goes by; data keep the room that they were made with.
MemoryLayout memory_layout(const mjModel_* m, int contact_capacity);

}  // namespace dashpot
