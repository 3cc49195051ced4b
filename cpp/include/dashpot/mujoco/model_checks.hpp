// Whether the numbers of a model can be stepped with.

#pragma once

struct mjModel_;

namespace dashpot::host {

// Of what may be edited between steps. Throws std::invalid_argument that names the field, the value
// and the geom, pair, flex, body, joint, tendon or equality: friction, masses and sizes that are
// negative or not finite, condim other than 1, 3, 4 or 6, a time step that is not positive, poses,
// data of equalities and options of the medium that are not finite, ranges that are no numbers.
void check_values(const mjModel_* m);

// The same of the heights of fields, which are many.
void check_heights(const mjModel_* m);

}  // namespace dashpot::host
