// MuJoCo's stages in the order of mj_step.
//
// mj_step is rebuilt from public calls; collision comes after the smooth acceleration, so that
// detection knows how far every body can move in this step.

#pragma once

#include <functional>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

// Finds the contacts of the present positions, in a room that knows detection.
using FindContacts = std::function<void(mjModel_*, mjData_*)>;

// Whether a callback of the smooth stage is set, which may read what the last step left.
bool callbacks_may_read();

// Kinematics, inertia, bias, passive and actuator forces, smooth acceleration (qacc_smooth).
// `new_control` false: controls are held, the control callback is not asked. Where the callbacks of
// this stage may read sensors, those of positions and velocities are made for them, as in mj_step,
// but without contacts and rows; detection makes them again.
// `find_contacts` is asked where there is adhesion, which pulls along their normals.
enum class Sensors { kForCallbacks, kStay };
void smooth_stage(mjModel_* m, mjData_* d, bool new_control, Sensors sensors,
                  const FindContacts& find_contacts);

// Makes sensors of positions and velocities anew where some look at contacts, which changed.
void make_contact_sensors(const mjModel_* m, mjData_* d);

// Sets the generalized forces of rows (nv), qfrc_constraint, and qacc, which follows from them and
// the smooth forces; with `discrete` through H, from the smooth acceleration of the part.
void set_forces(const mjModel_* m, mjData_* d, const Trees& trees,
                const std::vector<double>& smooth_acceleration,
                const std::vector<double>& constraint_force);
const double* acceleration(const mjData_* d);  // qacc
// Exchanges both with those of `d`.
void exchange_forces(mjData_* d, std::vector<double>& constraint_force,
                     std::vector<double>& acceleration);
// Reports the mean forces of rows over the step as efc_force, then evaluates acceleration sensors.
void report_forces(const mjModel_* m, mjData_* d, const std::vector<ContactInput>& contacts,
                   const std::vector<ConstraintInput>& constraints, const Rows& rows,
                   const std::vector<double>& row_force);

// MuJoCo's own integrator, under the forces that set_forces has set: advances everything.
// `uses_motion`: whether any of the velocities and positions that it comes to stays; else time,
// activations and plugins alone do. `any_rows`: rows act; in the stages of RK4 MuJoCo would solve
// for them, so they are taken as with Euler.
void integrate(mjModel_* m, mjData_* d, bool uses_motion, bool any_rows);
// MuJoCo's Euler for time, activations and plugins alone: without the implicit damping of its
// velocities, for which it would factor an inertia.
void advance_all_but_motion(mjModel_* m, mjData_* d);
bool is_runge_kutta(const mjModel_* m);

}  // namespace dashpot::host
