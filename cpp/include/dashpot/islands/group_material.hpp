// Which material a contact or constraint has.

#pragma once

#include <array>
#include <cmath>

#include "dashpot/law/material.hpp"
#include "dashpot/law/parameters.hpp"
#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

// What gives a group its stiffness and damping: a material in SI units; nothing, which means as
// rigid as the micro-steps resolve; or the model's own solref, a rigid row that is no stiffer than
// k = kappa / A and has the damping d = delta / sqrt(A w) then, A being the typical inverse mass of
// its first row (solref.hpp).
struct GroupMaterial {
  Material material;
  bool from_solref = false;
  double normalised_stiffness = 0.0;  // kappa, 1/s^2
  double normalised_damping = 0.0;    // delta, 1/s
  double own_damping = 0.0;           // the same without what presses it between others, 1/s
  double load = 0.0;                  // A F, m/s^2, that the model's own solref is read at
  bool is_clamped = false;            // of a body between others (solref_load.hpp)

  // Its stiffness is in SI units, which micro-steps have to resolve; all others go by these.
  bool has_si_stiffness() const { return !from_solref && !material.rigid; }
  // Nothing limits that: neither a stiffness nor a solref was given.
  bool is_rigid() const { return !from_solref && material.rigid; }
  // The damping ratio of a single contact on a model's own solref, whatever its mass and load.
  double damping_ratio() const {
    return normalised_damping > 0.0 ? 0.5 * normalised_damping / std::sqrt(normalised_stiffness)
                                    : 0.0;
  }
};

// What a model's own solref means under a load A F (m/s^2). Throws as solref_to_spring does.
GroupMaterial solref_material(const std::array<double, 2>& solref,
                              const std::array<double, 5>& solimp, double load);

// That of a contact: of its pair, else combined from its geoms, else what the model's own solref
// means under a load A F (m/s^2), else rigid.
GroupMaterial material_of(const mjModel_* model, const Parameters& parameters,
                          const ContactInput& contact, double load);
// That of a limit, an equality or dry friction: what the model's own solref means where its
// impedance has grown to the full, else rigid. Throws as solref_to_spring does.
GroupMaterial material_of(const ConstraintInput& constraint);

// The friction coefficients of a contact: the model's, unless its material has its own.
std::array<double, 5> friction_of(const ContactInput& contact, const Material& material);

}  // namespace dashpot
