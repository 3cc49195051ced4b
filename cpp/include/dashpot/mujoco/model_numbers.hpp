// The numbers that a model has of its objects.

#pragma once

struct mjModel_;

namespace dashpot::host {

// Throws std::invalid_argument that names the field, the value and the geom, pair, flex, body,
// joint, site, equality, tendon or actuator where one of what steps read of these is not finite (a
// range, or the margin of a limit: is no number), or is negative where it must not be (friction,
// sizes, armatures), or a solref that may act is of mixed format: one number positive, the other
// one not. Masses: check_masses. Not looked at: shapes of fluid, wrapping and meshes of flexes.
void check_numbers(const mjModel_* m);

}  // namespace dashpot::host
