// Whether the numbers of a model can be stepped with.

#pragma once

struct mjModel_;

namespace dashpot::host {

// Of what may be edited between steps. Throws std::invalid_argument that names the field, the value
// and whose it is: numbers and masses (check_numbers, check_masses), condim other than 1, 3, 4 or
// 6, geoms of a type that lacks what it is made of, a time step that is not positive, options of
// the medium that are not finite.
void check_values(const mjModel_* m);

// The same of the heights of fields, which are many.
void check_heights(const mjModel_* m);

}  // namespace dashpot::host
