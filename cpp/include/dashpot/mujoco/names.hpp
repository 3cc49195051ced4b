// How messages call MuJoCo's objects and what its rows come from.

#pragma once

#include <string>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// How messages call an object of MuJoCo's type `type`: its name in quotes, or # and its id.
std::string named(const mjModel_* m, int type, int id);
// The same for a side of a contact: a geom, or the flex -1 - geom.
std::string contact_side(const mjModel_* m, int geom);

// The joint, tendon or equality that a row of MuJoCo's constraints comes from, and what
// of it: "limit of joint 'knee'".
std::string constraint_name(const mjModel_* m, const mjData_* d, int row);

}  // namespace dashpot::host
