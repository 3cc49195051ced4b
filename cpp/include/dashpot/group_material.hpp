// Which material a contact or constraint has.

#pragma once

#include "dashpot/material.hpp"
#include "dashpot/parameters.hpp"
#include "dashpot/rows.hpp"

struct mjModel_;

namespace dashpot {

// What gives a group its stiffness and damping: a material, or a mass-normalised spring-damper
// k = s / w, d = c / w (MuJoCo's solref).
struct GroupMaterial {
  Material material;
  bool mass_normalised = false;
  double normalised_stiffness = 0.0;  // s, 1/s^2
  double normalised_damping = 0.0;    // c, 1/s

  bool rigid() const { return !mass_normalised && material.rigid; }
};

// That of a contact: of its pair, else combined from its geoms, else what the model's own solref
// means, else rigid.
GroupMaterial material_of(const mjModel_* model, const Parameters& parameters,
                          const ContactInput& contact);
// That of a limit, an equality or dry friction: what the model's own solref means, else rigid.
GroupMaterial material_of(const ConstraintInput& constraint);

}  // namespace dashpot
