// What MuJoCo derives from masses when it compiles a model: inertia of the degrees of freedom that
// it calls simple, masses of subtrees, and typical inverse masses.
//
// A body without children whose inertial frame is its own frame, as most free boxes and balls are,
// has a diagonal inertia that does not depend on its pose. MuJoCo reads it from a constant,
//
//     dof_M0 = mass or principal moment + armature ,
//
// which mj_setConst computes, while weight comes from body_mass itself: where a mass was edited
// alone, bodies would fall by the new weight on the old inertia. The work of gravity is that of the
// weights of subtrees, body_subtreemass. What is small near a singular configuration, and how stiff
// a solref is, go by body_invweight0, dof_invweight0 and tendon_invweight0, the inverse inertia in
// the pose of the model.

#pragma once

struct mjModel_;

namespace dashpot::host {

// Throws std::invalid_argument naming a body whose mass or moment of inertia is not finite, is
// negative, or is 0 where simple degrees of freedom need it.
void check_masses(const mjModel_* m);

// Of masses that check_masses has passed, sets dof_M0 of simple degrees of freedom,
// body_subtreemass and the inverse masses where body_mass, or body_inertia or dof_armature of a
// simple degree of freedom, was edited since; where others than lone free bodies were, by
// mj_setConst in a copy of the model. What differs in rounding alone stays: once this was called,
// threads that share a model's arrays and call it do not write to them.
void follow_edited_masses(mjModel_* m);

}  // namespace dashpot::host
