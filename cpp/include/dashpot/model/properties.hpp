// What the solver asks about a model, its bodies, geoms and their contacts.

#pragma once

#include <array>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

int geom_count(const mjModel_* m);
int dof_count(const mjModel_* m);
int position_count(const mjModel_* m);
int flex_count(const mjModel_* m);
int driven_count(const mjModel_* m);
bool has_equalities(const mjModel_* m);
bool has_adhesion(const mjModel_* m);     // of actuators or of geoms
double gravity(const mjModel_* m);        // m/s^2; 0 if it is disabled
double usual_gravity(const mjModel_* m);  // m/s^2; on earth if there is none
// A metre in the model's unit of length, which gravity tells: a thousand where it is 9810, and one
// where it is no more than on earth.
double metre(const mjModel_* m);

// Friction and priority of a side of a contact: a geom, or -1 - id for a flex.
std::array<double, 3> geom_friction(const mjModel_* m, int geom);
int geom_priority(const mjModel_* m, int geom);
int geom_tree(const mjModel_* m, int geom);  // -1 for static ones
// The body that joints move a geom with; -1 for static ones and flexes.
int moved_body(const mjModel_* m, int geom);
// MuJoCo's typical inverse mass (1/kg) of the geom's body in translation.
double geom_inverse_mass(const mjModel_* m, int geom);
// The last degree of freedom that moves a body against the world, -1 for none.
int last_dof(const mjModel_* m, int body);
// Whether a degree of freedom turns what it moves.
bool is_rotational(const mjModel_* m, int dof);

// Radius (m) about the smaller geom of a contact; infinite if neither has one.
double contact_radius(const mjModel_* m, const ContactInput& input);
// The same, but no more than a few half-thicknesses of what can move: what a sheet may sag goes by
// how thick it is, or those of a pile lie in each other.
double bearing_radius(const mjModel_* m, const ContactInput& input);
// Mass (kg) of the lighter of the kinematic trees whose geoms touch; infinite for flexes.
double contact_mass(const mjModel_* m, const ContactInput& input);

// Geoms that are only to be seen may still be named in a contact pair.
bool may_collide(const mjModel_* m, int geom);
// How many contacts there is memory for.
int contact_capacity(const mjModel_* m);

}  // namespace dashpot::host
