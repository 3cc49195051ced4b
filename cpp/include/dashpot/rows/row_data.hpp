// What changes of the rows and trees during a step: springs, velocities, impulses and energies.

#pragma once

#include <vector>

#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot {

// Energies (J) of contact normals, of friction, and of limits, equalities and dry friction loss.
struct EnergyShares {
  double normal = 0.0, friction = 0.0, constraint = 0.0, damping = 0.0;
  double sum() const { return normal + friction + constraint + damping; }
  EnergyShares& operator+=(const EnergyShares& other) {
    normal += other.normal;
    friction += other.friction;
    constraint += other.constraint;
    damping += other.damping;
    return *this;
  }
};
// The share that the energy of row i of a group belongs to.
double& share(EnergyShares& shares, const RowGroup& group, int i);

// What the micro-steps change.
struct RowData {
  // Per row. `deformation` is the spring gap x of a normal or limit (negative when compressed),
  // the strain of an equality, the elastic displacement s of a friction row; m or rad.
  std::vector<double> deformation, rate;
  std::vector<double> total_impulse;  // over the whole step, N s or N m s

  // Per group: deformation minus position, which is the unstressed part still to recover or, where
  // the spring is deformed beyond the position, preload (recall.hpp); whether friction last stuck,
  // whether any impulse acted in this step; what it is to a hit, and whether contacts between two
  // trees are all that counts in its island (island_hits.hpp).
  std::vector<double> unstressed;
  std::vector<char> sticking, touched;
  std::vector<Hit> hit;
  std::vector<char> is_of_isolated_pair;
  // Per group: energy (J) that rising stiffness took from its springs and falling stiffness may
  // give back (recall.hpp).
  std::vector<double> energy_tank;
  // Per group: energy (J) of a spring that grows stiffer with its position (solref_load.hpp),
  // beyond that of one that has been as stiff all the way.
  std::vector<double> beyond;
  // Per group: integral of the force of an equality times the time since the start, N s^2, N m s^2.
  std::vector<double> force_moment;
  // Per group: work (J) that a contact frozen within the step would have done by its turning.
  std::vector<double> turning_work;
  // Per group: work (J) that its forces did on its surfaces because these accelerate, beyond that
  // at the velocities which they have at RowGroup::ahead.
  std::vector<double> acceleration_work;
  // Per group: how much faster (m/s) the gap of a turning contact grows than by the rates of its
  // normal (detect/turning.hpp). It is no motion of bodies.
  std::vector<double> drift;

  // Per motion coordinate: velocity at the start, which smooth forces know of; what of the smooth
  // acceleration is no part of the integrator's; the energy (J) that the drag of damped trees took,
  // and the impulse of the pull of sprung ones (microstep.hpp).
  AlignedDoubles start_motion, added_acceleration, braked, pulled;

  // Per motion coordinate; `coordinate_impulse`, of the rows over the step, is a wrench of a free
  // body, a generalized impulse elsewhere.
  AlignedDoubles velocity, smooth_acceleration, total_displacement, coordinate_impulse;

  // Work done on the bodies, and energy put in by recovery, J.
  EnergyShares work, recovery_input;

  // These resize and zero the arrays per motion coordinate, and those per row and group.
  void reset_motion(int coordinates);
  void reset_rows(const Rows& rows);
};

// bearable_compression() (rows.hpp); of a limit beside what smooth forces press it with, twice: a
// light lever that a spring holds at the end of its range recovers, what two rows squeeze does not.
double bearable_of(const Rows& rows, const RowData& data, const RowGroup& group,
                   double recovery_speed);

// How fast (m/s) the overlap of a group recovers at most: as recovery_speed_along says, but not
// while a contact of SI stiffness throws back what hit it, with more than kHitLoads times the load
// of smooth forces. What takes milliseconds there takes a corner to the next one, which is deep
// already; to push that out under the force of a hit added half of its energy. Contacts on a
// model's own solref are damped too much to throw anything back.
double recovery_speed_of(const Rows& rows, const RowData& data, int index, double recovery_speed);

// Elastic energy stored in the springs, of all groups or of some, J.
EnergyShares elastic_energy(const Rows& rows, const RowData& data, Team& team);
double elastic_energy(const Rows& rows, const RowData& data, const std::vector<int>& groups);

// The energy ledger, J since the data was made or reset: kinetic + potential + elastic + dissipated
// - work is constant. `elastic` is the present store.
struct EnergyLedger {
  double elastic = 0.0;
  double dissipated_normal = 0.0;  // and what frozen inertia takes (or, negative, gives) in hits
  double dissipated_friction = 0.0;
  double dissipated_constraint = 0.0;
  double dissipated_recovery = 0.0;  // negative when recovery has put energy in
  double dissipated_damping = 0.0;   // by dampers of joints and tendons, and by fluids
  // Of actuators, applied forces, gravity compensation, mocap bodies and moving surfaces.
  double work = 0.0;

  // What contacts have dissipated, J, with what recovery took or put in.
  double dissipated_by_contacts() const {
    return dissipated_normal + dissipated_friction + dissipated_recovery;
  }
};

// Books what rows did in a step: `before` and `after`: elastic energies of memory and after
// micro-steps. Elastic energy that memory did not bring back, and work of the recovering surface,
// count as recovery; what the rows took from the bodies and did not store was dissipated.
void book_rows(const RowData& data, const EnergyShares& before, const EnergyShares& after,
               EnergyLedger& ledger);

}  // namespace dashpot
